"""The command ends cleanly after Ctrl-C at any time, and the robots walk on under many requests of a page."""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from live.view.controller import ViewController
from live.view.loop import LiveView
from live.view.requests import Request


@pytest.fixture
def view() -> Iterator[tuple[ViewController, LiveView]]:
    driver = ViewController(["stand"])
    found = LiveView(driver, 0)
    with closing(driver), closing(found):
        yield driver, found


def test_a_page_that_never_stops_asking_does_not_stop_the_robots(view: tuple[ViewController, LiveView]) -> None:
    (driver, live), asked = view, 0

    def ask(request: Request) -> None:
        nonlocal asked
        asked += 1
        assert asked < 10_000, "the robots stand still"
        live.receive('{"do": "drag", "right": 1, "down": 0}')

    driver.handle = ask  # type: ignore[method-assign]
    live.receive('{"do": "drag", "right": 1, "down": 0}')
    end = time.monotonic() + 60.0
    while driver.sessions[0].latest.number <= 3 and time.monotonic() < end:  # a busy machine may take longer
        live.run(0.1)
    assert driver.sessions[0].latest.number > 3
    assert asked > 3


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
def test_ctrl_c_is_not_lost_where_an_exception_would_be(view: tuple[ViewController, LiveView]) -> None:
    """Ctrl-C comes in a finaliser, where exceptions are lost and which a control step may run at any time."""

    class Finalised:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    driver, live = view
    moves = 0

    def move() -> bool:
        nonlocal moves
        moves += 1
        assert moves == 1, "the view goes on"
        Finalised()
        return True

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        driver.step = move  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            live.run()
    finally:
        signal.signal(signal.SIGINT, before)
