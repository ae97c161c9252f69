"""Models of the robot's sensors, and observations from the sensors instead of the simulator's state."""
