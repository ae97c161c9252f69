"""Intervals, tests, breaking points, and the calibration that shows that they hold what they promise."""
