"""Commands of `python -m quad_env` that need policies: live view, films, recordings, ROS and checks."""
