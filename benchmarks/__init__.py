"""What is fast and what it costs: every figure a ratio or a median of one interleaved run."""
