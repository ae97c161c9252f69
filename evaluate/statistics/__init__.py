"""Statistics of an evaluation: confidence intervals, significance tests and breaking points."""
