"""Studies and self-checks behind the project's own tables; imported by nothing, run by name."""
