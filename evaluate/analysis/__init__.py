"""What the episodes of a run show: figures, paired differences and breaking points."""
