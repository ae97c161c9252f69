"""Calibration of the confidence intervals and tests: their error rates on synthetic data with a known truth."""
