"""What the episodes of a run show: figures, paired differences, breaking points, findings in words."""
