"""Fuzzing of the readers of other people's files, by structured mutations of valid files."""
