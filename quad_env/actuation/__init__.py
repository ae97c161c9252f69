"""Actuators of the joints: parameters, models that run in every physics step, and hardware profiles."""
