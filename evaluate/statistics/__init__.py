"""Intervals, tests and breaking points."""
