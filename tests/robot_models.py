"""A mark for tests that need the models of other robots, which are in a package of their own."""

from importlib.util import find_spec

import pytest

from quad_env.robots.registry import EXTRA, WHEEL

NEEDS_MODELS = pytest.mark.skipif(find_spec(WHEEL) is None, reason=EXTRA)
