"""Commands of `python -m quad_env` that need policies, a module each."""
