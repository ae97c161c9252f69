"""Recovery from falls: `python -m research recovery` counts robots that stand up from a random pose.

Each robot starts with a random orientation, random joint angles within the joint limits, and random velocities. Its
lowest point touches flat ground (`quad_env.AnyPose`). A robot counts if it stands up within 5 s, and then stands until
the end of the episode at 6 s. The time to stand is the time at which the robot begins to stand, by `is_standing`.
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
"""Largest angle between trunk and vertical at which a robot counts as standing, rad."""
STANDING_HEIGHT = 0.45
"""Smallest height of the trunk centre above the terrain at which a robot counts as standing, m."""
STANDING_SPEED = 0.3
"""Largest velocity at which a robot counts as standing.

The limit applies to each component of linear velocity, m/s, and angular velocity, rad/s, in the base frame.
"""
LYING = replace(SCENARIOS["flat"], name="lying", start=AnyPose())
"""Scenario in which the robots start in a random pose on flat ground, as after a fall."""
TIME_ALLOWED = 5.0
"""Time from the start of the episode within which a robot must stand up to count as recovered, s."""
WATCHED = 6.0
"""Duration of an episode, s.

The episode is longer than TIME_ALLOWED, so that a robot that stands up and falls again does not count as recovered."""


@dataclass(frozen=True)
class RecoveryResult:
    """Result of n robots that try to stand up from random poses, made by `run_recovery`."""

    standing_since: Floats
    """Time from which each robot stands without a break until the end of the episode, (n,), s.

    The time is infinite if the robot does not stand at the end."""
    peak_torque: float
    """Largest absolute joint torque over all robots, joints and control steps, N·m."""
    diverged: int
    """Number of robots with a diverged simulation (numerically unstable state)."""


@dataclass(frozen=True)
class RecoveryOptions:
    """Options of the command `recovery`: number of robots, and seeds of their initial states."""

    robots: int = 1000
    """Number of robots; each has a different random initial state."""
    seed: int = 0
    """Seed of the initial states, >= 0."""
    seeds: Literal["search", "validation", "evaluation"] = "evaluation"
    """Purpose of the seeds; the recovery motion was optimised with seeds of the purpose "search"."""


def main(options: RecoveryOptions) -> int:
    """Run the command `recovery`: simulate recoveries and print the result.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    check_numbers(options, {"robots": (1, 65_536), "seed": (0, 2**31)})
    print(format_result(run_recovery(episode_seeds(options.seeds, options.seed, options.robots))))
    return 0


def run_recovery(seeds: NDArray[np.int64]) -> RecoveryResult:
    """Simulate the recovery of robots from random poses on flat ground.

    Args:
        seeds: Seed of the initial state of each robot, (n,).

    Returns:
        Times, torques and divergences of the n robots.
    """
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
    """Return a mask of the robots that stand: upright, with the trunk high enough, and almost at rest.

    A robot with a diverged simulation does not count as standing, although the simulation shows it in the home pose.

    Args:
        observation: Observations of the true states of n robots, (n, k): k numbers for each robot.
        infos: Dictionary `infos` of the environment after the same control step, with arrays (n, …).

    Returns:
        True for robots that stand, (n,).
    """
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(STANDING_TILT)
    motion = np.abs(observation[:, OBSERVATION["angular_velocity"].start : OBSERVATION["linear_velocity"].stop])
    still = motion.max(axis=1) < STANDING_SPEED
    return np.asarray(upright & still & (infos["height"] > STANDING_HEIGHT) & ~infos["diverged"])


def format_result(outcome: RecoveryResult) -> str:
    """Format the result of recoveries as lines of text."""
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
