"""Support of command-line programs: options, errors, exit codes, Ctrl-C, number formats and progress.

The package also contains the subprocess that reads users' files with limits on time and memory.
"""
