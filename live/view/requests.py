"""Requests of a page: JSON objects with the name of an action and its arguments, validated here."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

MAX_COMMAND = 3.0
"""m/s and rad/s. Largest magnitude of a command."""
MAX_ROBOTS = 4
"""Maximum number of robots side by side."""
MAX_IMPULSE = 500.0
"""N·s. Largest impulse of a push."""
SPEED_RANGE = (0.05, 10.0)
"""Smallest and largest ratio of simulated to wall time."""
MAX_SEED = 2**53 - 1
"""Largest seed; JavaScript does not represent larger integers exactly."""
MAX_NAME_LENGTH = 200
"""Maximum number of characters of the name of a policy or scenario."""


class RequestError(ValueError):
    """Invalid request; the message names the fault."""


@dataclass(frozen=True)
class Request:
    """A valid request."""

    do: str
    """Name of the action, a key of `REQUESTS`."""
    values: Mapping[str, Any]
    """Arguments of the action by name."""


def parse(text: str) -> Request:
    """Parse and validate a request.

    Args:
        text: Message of a page.

    Returns:
        The request.

    Raises:
        RequestError: The text is no JSON object, or names no action, or has invalid arguments.
    """
    try:
        given = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise RequestError("a request is a JSON object") from None
    if not isinstance(given, dict) or not isinstance(given.get("do"), str):
        raise RequestError('a request is an object such as {"do": "reset"}')
    if given["do"] not in REQUESTS:
        raise RequestError(f"nothing is called {given['do'][:40]!r}; there are {', '.join(REQUESTS)}")
    validators = REQUESTS[given["do"]]
    if set(given) - {"do"} != set(validators):
        raise RequestError(f"{given['do']} takes {', '.join(validators) or 'nothing else'}")
    return Request(given["do"], {name: validate(name, given[name]) for name, validate in validators.items()})


def _no_constant(name: str) -> float:
    """Raise ValueError for NaN or infinity."""
    raise ValueError(name)


def _number(low: float, high: float, kinds: Any = int | float) -> Callable[[str, Any], Any]:
    """Return a validator of numbers in a range."""
    kind = "whole number" if kinds is int else "number"

    def _validate(name: str, value: Any) -> Any:
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            raise RequestError(f"{name} is a {kind} between {low:g} and {high:g}")
        return value if kinds is int else float(value)

    return _validate


def _flag(name: str, value: Any) -> bool:
    """Return a truth value, or raise RequestError."""
    if not isinstance(value, bool):
        raise RequestError(f"{name} is true or false")
    return value


def _name(name: str, value: Any) -> str:
    """Return a printable name, or raise RequestError."""
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME_LENGTH or not value.isprintable():
        raise RequestError(f"{name} is a name of 1 to {MAX_NAME_LENGTH} characters")
    return value


_SPEED = _number(-MAX_COMMAND, MAX_COMMAND)
_PIXELS = _number(-5000.0, 5000.0)
REQUESTS: dict[str, dict[str, Callable[[str, Any], Any]]] = {
    "steer": {"forward": _SPEED, "left": _SPEED, "turn": _SPEED},
    "let_go": {},
    "push": {"direction": _number(-360.0, 360.0), "impulse": _number(0.0, MAX_IMPULSE)},
    "policy": {"robot": _number(0, MAX_ROBOTS - 1, int), "name": _name},
    "alone": {},
    "scenario": {"name": _name},
    "reset": {"seed": _number(0, MAX_SEED, int)},
    "next": {},
    "pause": {"on": _flag},
    "step": {},
    "speed": {"factor": _number(*SPEED_RANGE)},
    "drag": {"right": _PIXELS, "down": _PIXELS},
    "zoom": {"wheel": _PIXELS},
    "follow": {"on": _flag},
}
"""Name of each action -> its arguments and their validators.

Units: m/s and rad/s, degrees from the heading to the left, N·s, pixels.
"""
