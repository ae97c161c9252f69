"""Finds what is wrong with an installation, a robot or a policy, root causes first, and names the remedies."""
