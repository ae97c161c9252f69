"""What the episodes of a run show: figures, paired differences, breaking points and gates."""
