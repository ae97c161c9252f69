"""Benchmarks of speed and cost.

Functions that are compared take turns in one run. Every result is a ratio of their durations, or a median over rounds.
"""
