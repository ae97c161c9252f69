"""Simulation of episodes: one policy on one scenario side by side, in batteries of scenarios and worker processes."""
