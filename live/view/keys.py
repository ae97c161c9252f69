"""Keys of the native window, the same as those of the page."""

from collections.abc import Callable

from live.view.driver import Driver
from live.view.requests import FASTEST, Request

FORWARD, LEFT, TURN = 0.1, 0.1, 0.2
"""What a key adds to the command, m/s and rad/s."""
PUSH = {"direction": 90.0, "impulse": 30.0}
"""From the robot's right, N·s."""
_RIGHT_ARROW, _LEFT_ARROW, _DOWN, _UP = range(262, 266)
"""GLFW's codes; those of letters are their capitals'."""


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
