"""Fuzzing of the functions that read files of users and of other projects: a test with faulty files.

The files contain policies, robots or terrains. Random changes of valid files give the faulty files.
"""
