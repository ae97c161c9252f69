"""Scenarios: terrain, disturbances and commands as values, and what an episode draws from them."""
