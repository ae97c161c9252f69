"""Function types of external policies that are no `Policy`."""

from collections.abc import Callable
from typing import Any

ActFunction = Callable[[Any], object]
"""Maps an observation to an action, of one robot or of several."""
ActFactory = Callable[[], ActFunction]
"""Makes an `ActFunction` without memory of any robot."""
