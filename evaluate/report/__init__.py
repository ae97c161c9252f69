"""Tables on the terminal, and the HTML report."""
