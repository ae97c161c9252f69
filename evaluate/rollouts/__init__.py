"""Simulation of episodes side by side, batteries of scenarios, and worker processes."""
