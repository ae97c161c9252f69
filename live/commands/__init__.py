"""Commands of `python -m quad_env` that need policies; each command is one module."""
