"""What the benchmarks measure in processes or settings of their own."""
