"""Ctrl-C: the first one is stored at any time and stops the code that checks for it; the second ends the process."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from quad_env.cli.interrupt import Interrupt
from quad_env.cli.progress import show_bar

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")

TWICE = """
import signal
from quad_env.cli.interrupt import Interrupt

signal.signal(signal.SIGINT, signal.default_int_handler)
with Interrupt() as interrupt:
    signal.raise_signal(signal.SIGINT)
    print(interrupt.requested, flush=True)
    try:
        signal.raise_signal(signal.SIGINT)
        print("goes on")
    finally:
        print("never printed")
"""


class Finalised:
    """Object that raises Ctrl-C in its finaliser, where exceptions are lost."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


@pytest.fixture(autouse=True)
def _listening() -> Iterator[None]:
    """Install the default handler, since a background job ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_in_a_finaliser_stops_a_loop_that_looks_for_it() -> None:
    rounds = 0
    with pytest.raises(KeyboardInterrupt), Interrupt() as interrupt:  # noqa: PT012
        for rounds in range(5):
            interrupt.check()
            if rounds == 2:
                Finalised()
    assert rounds == 3


def test_work_with_a_bar_stops_at_its_next_report() -> None:
    with pytest.raises(KeyboardInterrupt), show_bar("working") as progress:  # noqa: PT012
        progress(0.1)
        Finalised()
        progress(0.2)
        raise AssertionError("it works on")


def test_one_that_nothing_has_looked_for_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), Interrupt():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_another_error_is_not_hidden_by_it() -> None:
    with pytest.raises(ZeroDivisionError), Interrupt():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        raise ZeroDivisionError


def test_the_second_ends_the_process_at_once_in_one_line() -> None:
    ended = subprocess.run([sys.executable, "-c", TWICE], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 130
    assert ended.stdout == "True\n"
    assert ended.stderr == "interrupted again: ended at once, without what comes last\n"


def test_a_process_that_ignores_ctrl_c_goes_on_ignoring_it() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Interrupt() as interrupt:
        signal.raise_signal(signal.SIGINT)
        assert not interrupt.requested
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_in_another_thread_it_is_left_to_the_first() -> None:
    asked = []

    def work() -> None:
        with Interrupt() as interrupt:
            asked.append(interrupt.requested)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(60)
    assert asked == [False]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
