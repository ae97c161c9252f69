"""Training studies, learning curves, parameter search, and publication of trained policies."""
