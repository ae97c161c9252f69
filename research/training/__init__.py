"""Runs that compare training choices, and publishing of trained policies."""
