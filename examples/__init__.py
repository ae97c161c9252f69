"""Examples of the packages with other people's software: each file is a script of its own."""
