"""Episode records for tests of causes; nothing happens in them except the given signals."""

from typing import Any

import numpy as np

from evaluate.causes.record import EpisodeSignals
from evaluate.measures.episodes import empty_signal
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Stairs
from tests.evaluate.measures.uneventful import uneventful

STEPS, END = 300, 200
TIME_CONSTANT = 0.23604
"""s. √(0.54655 / 9.81)."""
RISER = Stairs(rise=0.15, run=0.3, landing=0.75)


FOLLOWS = "onset", "window", "shank", "capture_point_offset"
"""Derived fields of a record that a test may set directly."""


def recorded(
    scenario: Scenario | None = None, number: int = 1, end: int = END, robot: Robot = SIMPLE_QUAD, **known: Any
) -> EpisodeSignals:
    """Return the record of the second of two robots; by default it has fallen at step 200.

    Without further arguments the onset is at step 150, with the default window before and after it. `known` has
    signals, or values derived from signals.
    """
    signals = {name: known.pop(name) for name in [*known] if name not in FOLLOWS}
    scenario = scenario or Scenario("made")
    episodes = uneventful(robot, STEPS, 2, fall_step=np.array([END - 50, end]), scenario=scenario, **signals)
    record = EpisodeSignals(episodes, scenario, number)
    vars(record).update({"onset": 150, "window": slice(110, 160), **known})
    return record


def signal(name: str) -> np.ndarray:
    return empty_signal(SIMPLE_QUAD, name, STEPS, 2)
