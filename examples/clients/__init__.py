"""Other people's software on the environment as it is, a file a library; `python -m examples` runs them all."""
