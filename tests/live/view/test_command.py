"""The command ends cleanly whenever it is interrupted, and the robots walk on however much a page asks for."""

import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from evaluate.rollouts.hardware import Hardware
from live.view.driver import Driver, Start
from live.view.loop import LiveView
from live.view.quality import Quality
from live.view.requests import LARGEST_SEED, Request
from live.view.server import Server
from quad_env.__main__ import main

BEGUN_DEAF = """
import multiprocessing
from quad_env.cli.child_process import without_ctrl_c

tell = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
process = multiprocessing.get_context("spawn").Process(target=exec, args=(tell,))
with without_ctrl_c():
    process.start()
process.join()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_ctrl_c_while_it_loads_ends_in_one_line(delay: float, running: Any) -> None:
    command = [sys.executable, "-X", "importtime", "-m", "quad_env", "view", "--no-browser", "--port", "0"]
    with running(command) as view:
        assert view.stderr is not None
        while not view.stderr.readline().endswith(" quad_env.cli.command_line\n"):
            assert view.poll() is None
        time.sleep(delay)
        view.send_signal(signal.SIGINT)
        _, error = view.communicate(timeout=60)
    assert view.returncode == 130
    said = [line for line in error.splitlines() if not line.startswith("import time:")]
    assert len(said) == 1
    assert said[0].startswith("interrupted: ")


@pytest.mark.skipif(sys.platform == "win32", reason="no masks of signals there")
def test_the_first_process_that_is_begun_without_ctrl_c_is_so_before_it_loads() -> None:
    told = subprocess.run([sys.executable, "-c", BEGUN_DEAF], capture_output=True, text=True, check=True)
    assert told.stdout == "True\n"


def test_a_page_that_never_stops_asking_does_not_stop_the_robots(tmp_path: Path) -> None:
    asked = 0

    with closing(Driver(Start(("stand",), "flat", Hardware(), tmp_path))) as driver:

        def ask(request: Request) -> None:
            nonlocal asked
            asked += 1
            assert asked < 10_000, "the robots stand still"
            view.receive('{"do": "drag", "right": 1, "down": 0}')

        driver.do = ask  # type: ignore[method-assign]
        with closing(LiveView(driver, lambda receive: Server("127.0.0.1", 0, receive), Quality("low"))) as view:
            view.receive('{"do": "drag", "right": 1, "down": 0}')
            end = time.monotonic() + 60.0
            while driver.session.latest.number <= 3 and time.monotonic() < end:  # a busy machine may take longer
                view.run(0.3)
        assert driver.session.latest.number > 3
        assert asked > 3


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
def test_ctrl_c_is_not_lost_where_an_exception_would_be(tmp_path: Path) -> None:
    """Here in a finaliser, which a control step may run at any time."""

    class Finalised:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    moves = 0

    def move() -> bool:
        nonlocal moves
        moves += 1
        assert moves == 1, "the view goes on"
        Finalised()
        return True

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with closing(Driver(Start(("stand",), "flat", Hardware(), tmp_path))) as driver:
            driver.move = move  # type: ignore[method-assign]
            view = LiveView(driver, lambda receive: Server("127.0.0.1", 0, receive), Quality("low"))
            with closing(view), pytest.raises(KeyboardInterrupt):
                view.run()
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_seed_that_no_page_can_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", "--seed", str(LARGEST_SEED + 1)]) == 2
    assert "--seed" in capsys.readouterr().err
