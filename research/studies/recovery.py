"""Measured recovery: `python -m research recovery` counts fallen robots that then stand.

A start is any orientation, any joint angles within the limits, and random velocities, the lowest point on flat ground
(`quad_env.AnyPose`). The time to stand is the start of the last interval in which the robot stands, by `is_standing`,
until the end.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from evaluate.statistics.intervals import wilson_interval
from policies.base import CONTROL_PERIOD, Floats
from policies.behaviour import Behaviour, State
from quad_env import OBSERVATION, SCENARIOS, AnyPose
from quad_env.cli.command_line import check_numbers
from quad_env.cli.format import points_with
from quad_env.seeding import episode_seeds

STANDING_TILT = np.deg2rad(10.0)
"""Largest tilt of a robot that counts as standing, rad."""
STANDING_HEIGHT = 0.45
"""Smallest height of the trunk centre above the terrain of a robot that counts as standing, m."""
STANDING_SPEED = 0.3
"""Largest velocity of a robot that counts as standing, for each component in the base frame, m/s or rad/s."""
LYING = replace(SCENARIOS["flat"], name="lying", start=AnyPose())
"""Scenario on flat ground in which the robots start in a random pose."""
TIME_ALLOWED = 5.0
"""Time in which a robot must get up, s."""
WATCHED = 6.0
"""Duration of an episode, s.

The episode is longer than TIME_ALLOWED, so that a robot that falls again after it has stood up does not count."""


@dataclass(frozen=True)
class RecoveryResult:
    """Result of the recoveries of n robots."""

    standing_since: Floats
    """Time from which each robot stands until the end, (n,), s; infinite if the robot does not stand at the end."""
    peak_torque: float
    """Largest joint torque of all robots at the end of any control step, N·m."""
    diverged: int
    """Number of robots with a diverged simulation."""


@dataclass(frozen=True)
class RecoveryOptions:
    """Measure the recovery from falls."""

    robots: int = 1000
    """Robots (count), each with a random start of its own."""
    seed: int = 0
    """Seed of the starts, >= 0."""
    seeds: Literal["search", "validation", "evaluation"] = "evaluation"
    """Family of seeds; the keyframes were searched on "search"."""


def main(options: RecoveryOptions) -> int:
    """Measure the recoveries, print the result, and return the exit code."""
    check_numbers(options, {"robots": (1, 65_536), "seed": (0, 2**31)})
    print(format_result(run_recovery(episode_seeds(options.seeds, options.seed, options.robots))))
    return 0


def run_recovery(seeds: NDArray[np.int64]) -> RecoveryResult:
    """Simulate the recovery of one robot for each seed. The policy starts in its recovery state."""
    standing_since = np.full(len(seeds), np.inf)
    peak_torque = 0.0
    diverged = np.zeros(len(seeds), np.bool_)

    def observe(step: Step) -> None:
        nonlocal standing_since, peak_torque, diverged
        diverged = step.infos["diverged"]
        peak_torque = max(peak_torque, float(np.abs(step.infos["joint_torque"]).max()))
        stands = is_standing(step.observation, step.infos)
        standing_since = np.where(stands, np.minimum(standing_since, step.number * CONTROL_PERIOD), np.inf)

    steps = round(WATCHED / CONTROL_PERIOD)
    policy = Behaviour(start=State.RECOVER, follow=False)
    roll_out(policy, LYING, seeds, observe, steps=steps, command=np.zeros(3), terminate_on_fall=False)
    return RecoveryResult(standing_since, peak_torque, int(diverged.sum()))


def is_standing(observation: NDArray[np.float32], infos: dict[str, Any]) -> NDArray[np.bool_]:
    """Return a mask of the robots that stand: upright, with the trunk high enough, and almost still.

    A diverged robot does not stand, although the simulation shows it in the home pose.

    Args:
        observation: Observation of the true state, (n, k).
        infos: Infos of the environment.

    Returns:
        True for robots that stand, (n,).
    """
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(STANDING_TILT)
    motion = np.abs(observation[:, OBSERVATION["angular_velocity"].start : OBSERVATION["linear_velocity"].stop])
    still = motion.max(axis=1) < STANDING_SPEED
    return np.asarray(upright & still & (infos["height"] > STANDING_HEIGHT) & ~infos["diverged"])


def format_result(outcome: RecoveryResult) -> str:
    """Format the result as lines of text."""
    stands = outcome.standing_since <= TIME_ALLOWED
    share = points_with(float(stands.mean()), wilson_interval(int(stands.sum()), len(stands)))
    times = outcome.standing_since[stands]
    lines = [
        f"standing within {TIME_ALLOWED:g} s: {stands.sum()} of {len(stands)}, "
        f"{share.value} % (95 % Wilson {share.interval} %)",
        f"largest torque {outcome.peak_torque:.1f} N·m; {outcome.diverged} diverged",
    ]
    if len(times):
        median, percentile_90, longest = np.quantile(times, (0.5, 0.9, 1.0))
        lines.append(f"time to stand: median {median:.2f} s, 90 % {percentile_90:.2f} s, longest {longest:.2f} s")
    return "\n".join(lines)
