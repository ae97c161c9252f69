"""Commands of `python -m quad_env` that need policies.

The commands show a live view, film and record episodes, connect the simulated robot to ROS, list the policies, and
check robots and policies.
"""
