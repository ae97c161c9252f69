"""Calibration of the evaluation's confidence intervals and tests: error rates on synthetic data."""
