"""Studies behind the project's own figures."""
