"""Live view: a page, served on this machine alone, with robots that the user steers."""
