"""Command lines, Ctrl-C, exit codes, and figures as people read them."""
