"""Confidence intervals, significance tests and breaking points."""
