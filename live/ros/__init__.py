"""The simulated robot as a node in ROS 1 or ROS 2, with the topics of the source document.

The simulation does not import ROS. A separate process runs in a Python that has ROS; it exchanges ROS messages with
other nodes, and numbers with the simulation.
"""
