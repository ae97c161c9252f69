"""Benchmarks: programs that measure the speed of environment, policies, training and commands.

The functions that a benchmark compares take turns in the same process. Every printed result is a ratio of durations, or
a median over the rounds in which each function is called once.
"""
