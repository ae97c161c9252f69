"""A run's folder: manifest, episodes, and what the figures were made with."""
