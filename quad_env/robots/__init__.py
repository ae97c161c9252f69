"""Robots: registry, parameters and kinematics, and the import of MJCF and URDF models."""
