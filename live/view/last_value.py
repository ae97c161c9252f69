"""A thread that works on the last value it was given, and skips those in between."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class LastValue(Generic[Item]):
    """Calls `take` with one item after the other, until it is closed or `take` returns False.

    Args:
        name: of the thread.
        leave: called in the thread in the end.
    """

    def __init__(self, name: str, take: Callable[[Item], bool], leave: Callable[[], None]) -> None:
        self._take, self._leave = take, leave
        self._item: Item | None = None
        self._news, self._ended, self._busy = threading.Condition(), False, False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def idle(self) -> bool:
        """Whether no item waits and none is in work."""
        with self._news:
            return self._item is None and not self._busy

    def hand(self, item: Item) -> None:
        """Replace the item that waits."""
        with self._news:
            self._item = item
            self._news.notify()

    def close(self) -> None:
        """End the thread after the item in work."""
        with self._news:
            self._ended = True
            self._news.notify()
        self._thread.join(timeout=10.0)

    def _next(self) -> Item | None:
        with self._news:
            self._busy = False
            self._news.wait_for(lambda: self._ended or self._item is not None)
            item, self._item = self._item, None
            self._busy = True
            return None if self._ended else item

    def _run(self) -> None:
        try:
            while (item := self._next()) is not None:
                if not self._take(item):
                    return
        finally:
            self._leave()
