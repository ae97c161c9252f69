"""A native window next to the page: the same robots, marks and keys, where there is a display."""

from collections.abc import Callable
from typing import Any

from live.view.camera import Picture
from live.view.driver import Driver
from live.view.last_value import LastValue
from live.view.requests import FASTEST, Request
from quad_env.cli.command_line import UsageError
from quad_env.physics.rendering import Window, shows_windows

FORWARD, LEFT, TURN = 0.1, 0.1, 0.2
"""What a key adds to the command, m/s and rad/s."""
PUSH = {"direction": 90.0, "impulse": 30.0}
"""From the robot's right, N·s."""
_RIGHT_ARROW, _LEFT_ARROW, _DOWN, _UP = range(262, 266)
"""GLFW's codes; those of letters are their capitals'."""


class NativeWindow:
    """Shows pictures in a window of MuJoCo's own viewer.

    Args:
        on_key: told GLFW's code of every key that is pressed in it, in a thread of the viewer.

    Raises:
        UsageError: there is no display.
    """

    def __init__(self, on_key: Callable[[int], None]) -> None:
        if not shows_windows():
            raise UsageError("--window needs a display: without one, open the page")
        self._on_key = on_key
        self._window: Window | None = None
        self._model: Any = None
        self._thread: LastValue[tuple[Picture, str]] = LastValue("window", self._take, self._forget)

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return self._window is None or self._window.is_open

    @property
    def idle(self) -> bool:
        """Whether it shows what it was handed."""
        return self._thread.idle

    def show(self, picture: Picture, text: str) -> None:
        """Show a picture, all robots in one, with a text in the corner, instead of what is not shown yet."""
        self._thread.hand((picture, text))

    def close(self) -> None:
        """Close the window."""
        self._thread.close()

    def _take(self, item: tuple[Picture, str]) -> bool:
        picture, text = item
        if picture.model is not self._model:
            self._forget()
            self._window, self._model = Window(picture.model, self._on_key), picture.model
        assert self._window is not None
        first, *others = picture.robots
        self._window.draw(first, others=others, marks=picture.marks, text=text)
        return True

    def _forget(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None


def request_of(key: int, driver: Driver) -> Request | None:
    """What a key of that code asks for; None of one that asks for nothing."""
    asked = _KEYS.get(key)
    return None if asked is None else asked(driver)


def _steer(forward: float = 0.0, left: float = 0.0, turn: float = 0.0) -> Callable[[Driver], Request]:
    def request(driver: Driver) -> Request:
        present = (0.0, 0.0, 0.0) if driver.session.command is None else driver.session.command
        changed = [round(float(a) + b, 2) for a, b in zip(present, (forward, left, turn), strict=True)]
        values = (min(FASTEST, max(-FASTEST, value)) for value in changed)
        return Request("steer", dict(zip(("forward", "left", "turn"), values, strict=True)))

    return request


_KEYS: dict[int, Callable[[Driver], Request]] = {
    _UP: _steer(forward=FORWARD),
    _DOWN: _steer(forward=-FORWARD),
    _LEFT_ARROW: _steer(turn=TURN),
    _RIGHT_ARROW: _steer(turn=-TURN),
    ord("A"): _steer(left=LEFT),
    ord("D"): _steer(left=-LEFT),
    ord(" "): lambda driver: Request("steer", {"forward": 0.0, "left": 0.0, "turn": 0.0}),
    ord("X"): lambda driver: Request("push", PUSH),
    ord("P"): lambda driver: Request("pause", {"on": not driver.paused}),
    ord("."): lambda driver: Request("step", {}),
    ord("R"): lambda driver: Request("reset", {"seed": driver.session.seed}),
    ord("N"): lambda driver: Request("next", {}),
}
