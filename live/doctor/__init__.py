"""Checks of `python -m quad_env doctor` that need policies: walking, trained policies, the viewer."""
