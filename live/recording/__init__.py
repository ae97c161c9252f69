"""Recordings of a robot as MCAP files, which a separate process writes."""
