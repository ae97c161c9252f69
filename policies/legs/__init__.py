"""Legs and the ground below them: kinematics, foot paths, ground plane, level frame."""
