"""`python -m quartercar`: the command line."""

from quartercar.cli import main

main()
