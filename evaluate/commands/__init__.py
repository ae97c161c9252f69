"""Subcommands of `python -m evaluate`, with one module for each subcommand."""
