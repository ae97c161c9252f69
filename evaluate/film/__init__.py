"""Films of simulated episodes, and HTML pages that show a film together with curves of the signals."""
