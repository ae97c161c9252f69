"""Scenarios: terrain, disturbances and commands as values, and the random draws of an episode."""
