"""Common code of all benchmarks.

The modules time functions, define benchmark commands, check requirements, and simulate robots with MuJoCo alone.
"""
