"""Fuzzing: tests of the functions that read files of users and other projects with faulty files.

The faulty files are made by random changes of valid files.
"""
