"""Gymnasium environments: a single environment of one robot, and a vector environment of n robots."""
