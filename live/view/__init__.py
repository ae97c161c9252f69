"""Live view: a web page with robots that the user steers, served only to browsers on the same machine."""
