"""Mark of tests that need the models of other robots, which are in a separate package."""

from importlib.util import find_spec

import pytest

from quad_env.robots.registry import INSTALL_COMMAND, MODEL_PACKAGE

NEEDS_MODELS = pytest.mark.skipif(find_spec(MODEL_PACKAGE) is None, reason=INSTALL_COMMAND)
