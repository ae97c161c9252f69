"""Display of the results of a run: tables on the terminal, and the HTML report."""
