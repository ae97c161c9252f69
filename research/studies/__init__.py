"""Studies, each of which answers one question by measurements in simulation."""
