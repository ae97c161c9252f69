"""Fall rules: when a robot counts as fallen, as defined by this project and by others.

No two projects agree, so that a fall rate means nothing without its rule. An evaluation runs under `simple-quad/1`; a
trace can be scored again under any of these.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools
from evaluate.measures.episodes import Episodes
from quad_env.config import FALL_RULE, FallRule

Holds = Callable[[Episodes], Bools]
"""Whether the rule holds at each step, (steps, n)."""


@dataclass(frozen=True)
class FallCriterion:
    """A rule of this project or of another, applied to a record; the environment's own is `FallRule`."""

    name: str
    words: str
    source: str
    """Project whose rule it is, or is closest to."""
    holds: Holds


_OWN = FallRule()
_OWN_TILT = f"{np.rad2deg(_OWN.tilt):g}°"
LOW = 0.2 / 0.75
"""Share of its height in the home pose: Ant-v5's lower bound, 0.2 m of a torso that starts at 0.75 m."""

RULES: dict[str, FallCriterion] = {
    rule.name: rule
    for rule in (
        FallCriterion(
            FALL_RULE,
            f"the trunk touches the ground, tilts over {_OWN_TILT}, or its centre is lower than a fifth of its legs",
            "this project",
            lambda it: it.trunk_contact | (it.tilt > _OWN.tilt) | (it.height < _OWN.lowest(it.robot.leg_length)),
        ),
        FallCriterion(
            "height-only",
            f"the trunk's centre is lower than {LOW:.3f} of its height in the home pose",
            "Gymnasium Ant-v5, in proportion; does not see a robot that lies on its side",
            lambda it: it.height < LOW * it.robot.home_height,
        ),
        FallCriterion("tilt-70", "the trunk tilts over 70°", "mjlab, flat ground", lambda it: it.tilt > np.deg2rad(70)),
        FallCriterion(
            "tilt-90",
            "the trunk tilts over 90°",
            "MuJoCo Playground Go1; legged_control",
            lambda it: it.tilt > np.deg2rad(90),
        ),
        FallCriterion(
            "trunk-contact",
            "the trunk touches the ground",
            "legged_gym and IsaacLab, there with a force over 1 N",
            lambda it: it.trunk_contact,
        ),
        FallCriterion(
            "non-foot-contact",
            "trunk, thigh or calf touches the ground",
            "gym-quadruped; here a hard landing is enough, where the calf's end touches the ground next to the foot",
            lambda it: it.trunk_contact | it.leg_contact,
        ),
    )
}


def fall_step(rule: FallCriterion, episodes: Episodes) -> NDArray[np.int64]:
    """First step at which the rule holds or the simulation diverges, (n,); `steps` if there is none.

    Under the environment's own rule that is the environment's result, which it found in double precision.
    """
    if rule.name == FALL_RULE:
        return episodes.fall_step
    return np.minimum(first_step(rule, episodes), episodes.divergence_step)


def first_step(rule: FallCriterion, episodes: Episodes) -> NDArray[np.int64]:
    """First step at which the rule holds in the record, (n,); `steps` if it never does."""
    holds = rule.holds(episodes)
    return np.where(holds.any(axis=0), holds.argmax(axis=0), episodes.steps)
