"""Studies that measure the numbers in the documentation of the project, and writers of their pages."""
