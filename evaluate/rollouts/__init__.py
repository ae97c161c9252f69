"""Simulation of many episodes together, batteries (named lists) of scenarios, and worker processes."""
