"""Support of command-line programs: options, one-line errors, exit codes, Ctrl-C, number formats, progress.

It also contains the subprocess that reads users' files with limits on time and memory.
"""
