"""Live view: a web page that shows simulated robots, which the user steers.

Only browsers on the same machine can open the page.
"""
