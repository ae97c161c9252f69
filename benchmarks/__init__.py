"""Benchmarks: programs that measure the speed of environment, policies, training and commands.

The functions that a benchmark compares take turns in the same process. A round calls each function once. Every printed
result is a ratio of durations, or a median over the rounds.
"""
