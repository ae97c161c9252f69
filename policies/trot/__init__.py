"""Diagonal trot gaits, open loop and with velocity feedback, and the reports of the searches for parameters."""
