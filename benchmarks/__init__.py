"""Benchmarks of speed and cost; every figure is a ratio or a median of one interleaved run."""
