"""Robots: names, geometry, limits and kinematics, and their MJCF and URDF."""
