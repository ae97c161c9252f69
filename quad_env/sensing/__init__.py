"""Simulated sensors, state estimators, and observations from the true state or from the sensors."""
