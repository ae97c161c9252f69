"""Actuator models, and what they do between targets and joints at every physics step."""
