"""The simulated robot as a ROS node, with the interface of the source document, in ROS 1 and ROS 2.

The simulation does not import ROS. A separate process, run by a Python that has ROS, passes messages on as numbers.
"""
