"""Diagonal trot, open loop and with feedback, and the accounts of the searches for their parameters."""
