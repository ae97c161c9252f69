"""Gaits by name, smooth changes between gaits, and the policies that follow a velocity command in a gait."""
