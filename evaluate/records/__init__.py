"""Results folders: manifest, provenance, and tables of episodes."""
