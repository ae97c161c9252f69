"""Parses and validates the requests that a web page of the live view sends.

A request is a JSON object with the name of an action and its arguments.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

MAX_COMMAND = 3.0
"""Largest absolute value of each component of a velocity command, m/s and rad/s."""
MAX_ROBOTS = 4
"""Maximum number of robots that the live view simulates and shows side by side."""
MAX_IMPULSE = 500.0
"""Largest impulse of a push that a page may request, N·s."""
SPEED_RANGE = (0.05, 10.0)
"""Smallest and largest simulation speed that a page may request, simulated time per wall time."""
MAX_SEED = 2**53 - 1
"""Largest seed of an episode; JavaScript does not represent larger integers exactly."""
MAX_NAME_LENGTH = 200
"""Maximum length of the name of a policy or scenario in a request, characters."""


class RequestError(ValueError):
    """Raised for an invalid request of a page; the message gives the reason."""


@dataclass(frozen=True)
class Request:
    """Valid request of a web page, made by `parse`."""

    do: str
    """Name of the requested action, a key of `REQUESTS`."""
    values: Mapping[str, Any]
    """Arguments of the action: name of an argument -> value."""


def parse(text: str) -> Request:
    """Parse and validate a request of a web page.

    Args:
        text: Message of the page.

    Returns:
        The request.

    Raises:
        RequestError: The text is not a JSON object, its action is unknown, or its arguments are invalid.
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
    """Refuse the JSON constants NaN and Infinity: raise ValueError with the name of the constant."""
    raise ValueError(name)


def _number(low: float, high: float, kinds: Any = int | float) -> Callable[[str, Any], Any]:
    """Return a function that checks that the argument of a request is a number from `low` to `high`.

    Args:
        low: Smallest valid number.
        high: Largest valid number.
        kinds: Valid types of the number.

    Returns:
        Function that takes the name and the value of an argument, and returns the value or raises RequestError.
    """
    kind = "whole number" if kinds is int else "number"

    def _validate(name: str, value: Any) -> Any:
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            raise RequestError(f"{name} is a {kind} between {low:g} and {high:g}")
        return value if kinds is int else float(value)

    return _validate


def _flag(name: str, value: Any) -> bool:
    """Check that the argument `name` of a request is a bool: return `value`, or raise RequestError."""
    if not isinstance(value, bool):
        raise RequestError(f"{name} is true or false")
    return value


def _name(name: str, value: Any) -> str:
    """Check that the argument `name` is a printable string: return `value`, or raise RequestError."""
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
"""All requests that a page can send: name of the action -> name of an argument -> function that checks the argument.

Units: `forward` and `left` in m/s, `turn` in rad/s, `direction` in degrees from the heading to the left, `impulse` in
N·s, `right` and `down` in pixels.
"""
