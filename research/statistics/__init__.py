"""Calibration of the confidence intervals and tests: error rates on data with a known truth."""
