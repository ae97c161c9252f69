"""Common parts of all benchmarks: timing, commands, requirements, and MuJoCo for comparison."""
