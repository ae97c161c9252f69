"""Paired comparison of policies: scenarios -> rollout -> metrics -> statistics -> table, files and report."""
