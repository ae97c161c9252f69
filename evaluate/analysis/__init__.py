"""Analysis of an evaluation run: summaries, differences, scores, ranking and breaking points."""
