"""Analysis of the measured episodes of an evaluation: summaries, comparisons, scores, ranking, breaking points."""
