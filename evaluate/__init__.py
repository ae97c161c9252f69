"""Evaluator: simulates policies in the same episodes, and writes their ranking, statistics and a report."""
