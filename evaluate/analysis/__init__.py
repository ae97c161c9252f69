"""Analysis of the episodes of a run: summaries, differences, scores, ranking and breaking points."""
