"""Films of episodes, and HTML pages that show a film with curves."""
