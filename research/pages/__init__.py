"""Writers of the tables and figures in the README and in docs."""
