"""Studies in simulation; each study answers one question by measurements."""
