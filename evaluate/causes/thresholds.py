"""The thresholds of the rules of causes: value, unit and reason of each stand in `thresholds.json`."""

import json
from pathlib import Path

from quad_env.robots.robot import Robot
from quad_env.robots.similarity import ratio

_FILE = Path(__file__).with_name("thresholds.json")
THRESHOLDS: dict[str, tuple[float, str, str]] = json.loads(_FILE.read_text(encoding="utf-8"))
"""Value, unit and reason by name."""


def at(name: str, robot: Robot) -> float:
    """The value for a robot: lengths, times and speeds are SimpleQuad's, and go with the length of the legs."""
    value, unit, _ = THRESHOLDS[name]
    return value * (ratio(robot, unit) if unit in ("m", "s", "m/s") else 1.0)
