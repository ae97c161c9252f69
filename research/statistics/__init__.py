"""Calibration of intervals and tests."""
