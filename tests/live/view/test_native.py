"""The native window: its keys are those of the page, and it never holds the robots back."""

import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from evaluate.rollouts.hardware import Hardware
from live.view.driver import Driver, Start
from live.view.last_value import LastValue
from live.view.native import NativeWindow, request_of
from live.view.requests import FASTEST, Request
from quad_env.cli.command_line import UsageError
from tests.waiting import until

UP, DOWN, LEFT, RIGHT = 265, 264, 263, 262
"""GLFW's codes."""


@pytest.fixture
def driver(tmp_path: Path) -> Iterator[Driver]:
    with closing(Driver(Start(("stand",), "flat", Hardware(), tmp_path))) as found:
        yield found


def press(driver: Driver, *keys: int) -> tuple[float, ...]:
    for key in keys:
        request = request_of(key, driver)
        assert request is not None
        driver.do(request)
    assert driver.session.command is not None
    return tuple(driver.session.command.tolist())


def test_keys_add_to_the_command_and_space_ends_it(driver: Driver) -> None:
    assert press(driver, UP, UP, LEFT, ord("D")) == (0.2, -0.1, 0.2)
    assert press(driver, DOWN, RIGHT, RIGHT, ord("A")) == (0.1, 0.0, -0.2)
    assert press(driver, *[UP] * 50) == (FASTEST, 0.0, -0.2)
    assert press(driver, ord(" ")) == (0.0, 0.0, 0.0)
    assert request_of(ord("P"), driver) == Request("pause", {"on": True})
    assert request_of(ord("Q"), driver) is None


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


def test_without_a_display_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UsageError, match="needs a display"):
        NativeWindow(lambda key: None)


@pytest.mark.rendering
@pytest.mark.skipif(not all(map(shutil.which, ("Xvfb", "xdotool"))), reason="needs Xvfb and xdotool")
def test_a_key_pressed_in_the_window_steers_and_closing_it_ends_the_view(tmp_path: Path, running: Any) -> None:
    """Under a virtual display; what the key did is read from the recording."""
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "640x480x24"], stdout=subprocess.PIPE, text=True
    )
    assert screen.stdout is not None
    display = {"DISPLAY": f":{screen.stdout.readline().strip()}"}
    words = ["view", "--window", "--no-browser", "--policy", "trot", "--port", "0"]
    file = tmp_path / "walk.mcap"
    try:
        command = [sys.executable, "-m", "quad_env", *words, "--record", str(file)]
        with running(command, env=_with(display)) as view:
            search = ("search", "--onlyvisible", "--name", "MuJoCo")
            found = until(lambda: _xdotool(display, *search), "no window came").split()[0]
            for key in ("Up", "Up", "Up", "ctrl+q"):
                _xdotool(display, "key", "--window", found, key)
                time.sleep(0.3)
            view.communicate(timeout=120)
        assert view.returncode == 0
    finally:
        screen.kill()
        screen.communicate()
    decoders = DecoderFactory()
    with file.open("rb") as recorded:
        commands = [
            decoders.decoder_for("cdr", schema)(message.data).linear.x
            for schema, _, message in make_reader(recorded).iter_messages(topics=["/cmd_vel"])
        ]
    assert commands[0] == 0.0
    assert sorted(commands) == commands
    assert {round(command, 3) for command in commands} in ({0.0, 0.1}, {0.0, 0.1, 0.2}, {0.0, 0.1, 0.2, 0.3})


def _with(display: dict[str, str]) -> dict[str, str]:
    return {**os.environ, **display}


def _xdotool(display: dict[str, str], *words: str) -> str:
    return subprocess.run(["xdotool", *words], env=_with(display), capture_output=True, text=True, check=False).stdout
