"""Task of the environment: observations, rewards, fall detection, and measurements for the evaluator."""
