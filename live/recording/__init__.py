"""Recordings of episodes as MCAP files of ROS 2 messages; a separate process writes the files."""
