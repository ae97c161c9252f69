"""Analysis of the episodes of a run: figures, paired differences, scores, ranking and breaking points."""
