"""Legs and the ground below them: kinematics, foot paths, footholds, contacts."""
