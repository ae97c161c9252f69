"""What the site needs besides Sphinx: its contents from a page's links, formulas and diagrams without a network."""
