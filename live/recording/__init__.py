"""Recordings of a walking robot as MCAP files, which a separate process writes."""
