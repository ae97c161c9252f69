"""Drake as a second simulator, an extra: `pip install -e ".[drake]"`."""
