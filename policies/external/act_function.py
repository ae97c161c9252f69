"""Types of the functions that represent an external policy that is not an instance of `Policy`."""

from collections.abc import Callable
from typing import Any

ActFunction = Callable[[Any], object]
"""Function that maps the observation of one robot or of several robots to the action.

With k observed values, the shapes are (k,) -> (12,) for one robot and (n, k) -> (n, 12) for n robots. The action is the
joint targets, rad, or the raw output of a network that has a specification.
"""
ActFactory = Callable[[], ActFunction]
"""Function without arguments that returns an `ActFunction` in its state at the start of an episode."""
