"""The subcommands of `python -m evaluate`, a module each."""
