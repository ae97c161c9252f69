"""Measures of an episode: outcome, command tracking, motor effort, gait and reaction to pushes."""
