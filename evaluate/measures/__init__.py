"""Measures of recorded episodes: outcome, command tracking, motor effort, gait and falls after pushes."""
