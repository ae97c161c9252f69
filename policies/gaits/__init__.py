"""Gaits such as walk, pace and bound, smooth transitions between them, and the policy that walks in a gait."""
