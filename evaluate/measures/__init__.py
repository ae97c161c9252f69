"""Measures of an episode: outcome, tracking, effort, gait and pushes."""
