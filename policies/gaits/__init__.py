"""Gaits (walk, trot, pace, bound, pronk), smooth transitions between them, and the policy `Gaits`."""
