"""Analysis of an evaluation's episodes: summaries, comparisons, scores, ranking and breaking points."""
