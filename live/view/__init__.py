"""The live view: a page, served on this machine alone, in which robots walk where they are steered."""
