"""Types of the functions that represent an external policy that is not a `Policy`."""

from collections.abc import Callable
from typing import Any

ActFunction = Callable[[Any], object]
"""Function from observations to actions, of one robot or of several robots."""
ActFactory = Callable[[], ActFunction]
"""Function without arguments that makes an `ActFunction` in the state of a starting episode."""
