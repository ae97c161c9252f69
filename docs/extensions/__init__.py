"""Extensions of Sphinx: contents from a page's links, formulas and diagrams without a network."""
