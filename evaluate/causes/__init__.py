"""Why episodes failed: written rules over what was recorded and what the scenario says."""
