"""`python -m lpvid`: the command line."""

from lpvid.cli import main

main()
