"""A run's folder: manifest, episodes, traces, and what the figures were made with."""
