"""Gaits as clocks and footfall patterns, changes between them, and the policies that follow a command with them."""
