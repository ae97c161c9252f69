"""Gaits by name, smooth changes between gaits, and the policy that follows commands in a gait."""
