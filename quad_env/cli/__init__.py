"""Command lines: options, one-line errors, exit codes, Ctrl-C, tables, progress."""
