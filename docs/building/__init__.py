"""What the documentation site generates: pages of the API, of the commands, of the examples."""
