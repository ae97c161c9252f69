"""Connects the simulated robot as a node to ROS 1 or ROS 2.

The ROS topics have the names and types that the article about the robot SimpleQuad gives. The simulation does not
import ROS. A separate process, the ROS process, runs in a Python executable that has ROS. The ROS process exchanges ROS
messages with other nodes, and packets of numbers with the simulation.
"""
