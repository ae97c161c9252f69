"""Evaluator: compares policies over the same episodes, and writes a ranking, statistics and a report."""
