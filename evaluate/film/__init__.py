"""Films and pages of episodes."""
