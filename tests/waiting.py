"""Waiting for what another thread or process does, on a machine that may be busy."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def until(seen: Callable[[], T], otherwise: str) -> T:
    """The first true value that is seen; after 60 s the test fails, for the reason given."""
    end = time.monotonic() + 60.0
    while not (found := seen()):
        assert time.monotonic() < end, otherwise
        time.sleep(0.02)
    return found
