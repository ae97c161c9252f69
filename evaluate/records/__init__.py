"""Files in a results folder of an evaluation: manifest with all inputs, and table of the episodes."""
