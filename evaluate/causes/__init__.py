"""Causes of failed episodes, by rules on the recorded signals and the scenario."""
