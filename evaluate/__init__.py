"""Paired comparison of policies: scenarios -> rollout -> measures -> statistics -> table and report."""
