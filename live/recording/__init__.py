"""Recordings of a walking robot: MCAP files, written by a process of their own."""
