"""Drake as a second simulator, an optional dependency: `pip install -e ".[drake]"`."""
