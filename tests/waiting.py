"""Wait for another thread or process on a busy machine."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def until(seen: Callable[[], T], otherwise: str) -> T:
    """Return the first true value of `seen`; after 60 s the test fails with the reason `otherwise`."""
    end = time.monotonic() + 60.0
    while not (found := seen()):
        assert time.monotonic() < end, otherwise
        time.sleep(0.02)
    return found
