"""Subcommands of `python -m evaluate`, one module each."""
