"""Scenarios: settings of terrain, disturbances and commands, and the random draws of an episode."""
