"""A walking robot to watch, steer, record and connect: the commands of `python -m quad_env` that need policies."""
