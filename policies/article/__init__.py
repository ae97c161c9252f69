"""The article's gait controller, as printed and repaired."""
