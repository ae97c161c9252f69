"""A thread takes the last value that it was given, and skips those in between."""

import threading

from live.view.last_value import LastValue
from tests.waiting import until


def test_the_newest_is_taken_and_what_came_in_between_is_left_out() -> None:
    taken: list[int] = []
    begun, go_on, left = threading.Event(), threading.Event(), threading.Event()

    def take(item: int) -> bool:
        taken.append(item)
        begun.set()
        return go_on.wait(60)

    latest = LastValue("test", take, left.set)
    assert latest.idle
    latest.hand(1)
    assert begun.wait(60)
    for item in (2, 3, 4):
        latest.hand(item)
    assert not latest.idle
    go_on.set()
    until(lambda: latest.idle, "it is still at work")
    latest.close()
    assert taken == [1, 4]
    assert left.is_set()
