"""Getting up from a fall: robots that start in random poses, and when each of them stands."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.at_rest import standing
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from policies.base import CONTROL_PERIOD, Floats, Policy
from quad_env import OBSERVATION, SCENARIOS, AnyPose

LYING = replace(SCENARIOS["flat"], name="lying", start=AnyPose())
TIME_ALLOWED, WATCHED = 5.0, 6.0
"""s for getting up, and of the whole episode: a robot that falls over again after standing up does not count."""


@dataclass(frozen=True)
class Outcome:
    """What became of n robots."""

    tilt: Floats
    """At the start, degrees, (n,)."""
    standing_since: Floats
    """s, infinite for a robot that does not stand at the end, (n,)."""
    peak_torque: float
    """Largest joint torque at the end of any control step, N·m."""
    diverged: int


def recover_with(policy: Policy, seeds: NDArray[np.int64], nthread: int = 1) -> Outcome:
    """One robot of that policy for each seed, all side by side."""
    tilt, since, peak, diverged = np.zeros(0), np.full(len(seeds), np.inf), 0.0, np.zeros(len(seeds), np.bool_)

    def watch(step: Step) -> None:
        nonlocal tilt, since, peak, diverged
        if step.number == 0:
            upright = -step.observation[:, OBSERVATION["projected_gravity"]][:, 2]
            tilt = np.rad2deg(np.arccos(np.clip(upright, -1.0, 1.0))).astype(np.float64)
        diverged = step.infos["diverged"]
        peak = max(peak, float(np.abs(step.infos["joint_torque"]).max()))
        stands = standing(step.observation, step.infos)
        since = np.where(stands, np.minimum(since, step.number * CONTROL_PERIOD), np.inf)

    steps = round(WATCHED / CONTROL_PERIOD)
    still = np.zeros(3)
    roll_out(policy, LYING, seeds, watch, steps=steps, nthread=nthread, command=still, terminate_on_fall=False)
    return Outcome(tilt, since, peak, int(diverged.sum()))
