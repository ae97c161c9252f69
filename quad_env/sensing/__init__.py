"""The robot's own sensors, and the observation that is built from them instead of from the simulator's state."""
