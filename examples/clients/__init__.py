"""Other people's software on the environment as it is, one file for each library."""
