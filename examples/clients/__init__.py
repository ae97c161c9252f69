"""Other people's software on the unchanged environment, one file per library."""
