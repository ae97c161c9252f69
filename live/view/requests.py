"""What a page may ask for: JSON objects, checked here once, each with the name of what is to be done."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

MAX_COMMAND = 3.0
"""Largest command that can be given, each way, m/s and rad/s."""
MAX_ROBOTS = 4
MAX_IMPULSE = 500.0
"""N·s"""
SPEED_RANGE = (0.05, 10.0)
"""Simulated s a wall s."""
MAX_SEED = 2**53 - 1
"""Larger whole numbers a page does not know exactly."""
MAX_NAME_LENGTH = 200
"""Longest name of a policy or scenario, characters."""


class RequestError(ValueError):
    """A request that is none; the message says what is wrong with it."""


@dataclass(frozen=True)
class Request:
    """Something to do, with the arguments that it was checked to have."""

    do: str
    values: Mapping[str, Any]


def parse(text: str) -> Request:
    """The request of that text. Raises RequestError."""
    try:
        given = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise RequestError("a request is a JSON object") from None
    if not isinstance(given, dict) or not isinstance(given.get("do"), str):
        raise RequestError('a request is an object such as {"do": "reset"}')
    if given["do"] not in REQUESTS:
        raise RequestError(f"nothing is called {given['do'][:40]!r}; there are {', '.join(REQUESTS)}")
    wanted = REQUESTS[given["do"]]
    if set(given) - {"do"} != set(wanted):
        raise RequestError(f"{given['do']} takes {', '.join(wanted) or 'nothing else'}")
    return Request(given["do"], {name: check(name, given[name]) for name, check in wanted.items()})


def _no_constant(name: str) -> float:
    raise ValueError(name)


def _number(low: float, high: float, kinds: Any = int | float) -> Callable[[str, Any], Any]:
    what = "whole number" if kinds is int else "number"

    def check(name: str, value: Any) -> Any:
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            raise RequestError(f"{name} is a {what} between {low:g} and {high:g}")
        return value if kinds is int else float(value)

    return check


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise RequestError(f"{name} is true or false")
    return value


def _name(name: str, value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME_LENGTH or not value.isprintable():
        raise RequestError(f"{name} is a name of 1 to {MAX_NAME_LENGTH} characters")
    return value


_SPEED, _PIXELS = _number(-MAX_COMMAND, MAX_COMMAND), _number(-5000.0, 5000.0)
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
"""Arguments of each request, with what checks them: m/s and rad/s, degrees from straight ahead to the left, N·s,
pixels."""
