"""Whether a policy stands and walks as its description says, and which of the usual mistakes explains it if not."""

from collections.abc import Callable

import numpy as np

from evaluate.rollouts.walking_test import Walk
from policies.base import PolicyError
from policies.foreign.description import PolicyDescription
from policies.foreign.mistakes import MISTAKES, Correction, Places, combined, corrections
from quad_env.robots.robot import Robot
from quad_env.seeding import episode_seeds

STAND = "to stand"
COMMANDS = {STAND: (0.0, 0.0, 0.0), "forward": (0.5, 0.0, 0.0), "in a curve": (0.5, 0.0, 0.8)}
"""m/s and rad/s of SimpleQuad; only in a curve is the world's frame another than the body's."""
SEEDS = episode_seeds("search", 0, 2)
NONE = f"none of the usual mistakes explains it; tried: {', '.join(MISTAKES)}"

Run = Callable[[PolicyDescription], list[Walk]]
"""Runs a policy as a description says."""


def cause(described: PolicyDescription, places: Places, robot: Robot, run: Run) -> Correction | None:
    """The correction with which a policy that fails walks best; None where it walks with none."""
    for tried in (corrections, combined):
        found = [(_deviation(run, each.description), each) for each in tried(described, places, robot)]
        best, correction = min(found, key=lambda each: each[0])
        if best <= 1.0:
            return correction
    return None


def _deviation(run: Run, described: PolicyDescription) -> float:
    try:
        return max(walk.deviation for walk in run(described))
    except PolicyError:
        return np.inf
