"""Diagonal trot by virtual model control of the stance feet."""
