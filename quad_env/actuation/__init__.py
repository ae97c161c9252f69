"""Joint actuators: their parameters, simulated motor models, and the hardware profile of each robot."""
