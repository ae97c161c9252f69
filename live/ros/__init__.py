"""The simulated robot as a ROS node: its interface is the source document's, in ROS 1 and ROS 2.

The simulation knows no ROS. A process of its own, run by whichever Python has ROS, hands messages over as numbers.
"""
