"""Results folders: manifest of a run's inputs, provenance of the results, and tables of the episodes."""
