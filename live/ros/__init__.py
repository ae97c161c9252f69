"""The simulated robot as a node in ROS 1 or ROS 2, with the topics of the article on the robot.

The simulation does not import ROS. A separate process, the ROS process, runs in a Python that has ROS. It exchanges ROS
messages with other nodes, and numbers with the simulation.
"""
