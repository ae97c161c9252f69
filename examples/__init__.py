"""Other people's ways to use the packages: each file stands alone and is run as a script."""
