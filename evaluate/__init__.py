"""Evaluator: simulates policies in equal episodes, and writes their ranking, statistics and a report."""
