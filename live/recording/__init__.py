"""Recordings of a walking robot: MCAP files and ROS 2 bags, written by a process of their own."""
