"""Commands of `python -m quad_env` that need policies.

They show a live view, film and record episodes, connect the simulated robot to ROS, and check robots and policies.
"""
