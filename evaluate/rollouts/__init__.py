"""Simulation of many episodes together, batteries of scenarios, and worker processes."""
