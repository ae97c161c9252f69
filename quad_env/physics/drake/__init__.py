"""Interface to the physics engine Drake, an optional dependency: `pip install -e ".[drake]"`."""
