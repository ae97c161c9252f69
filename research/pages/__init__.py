"""Writers of the tables in README and docs."""
