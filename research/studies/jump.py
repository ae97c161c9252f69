"""Jumps of standing robots: `python -m research jump` counts the robots that land standing.

The rise of a jump is the largest height of the trunk centre, minus its height in the home pose. The height is measured
at the end of each control step.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from policies.base import Floats
from policies.behaviour import Behaviour
from quad_env.cli.command_line import check_numbers
from quad_env.seeding import episode_seeds
from research.studies.recovery import is_standing

SETTLING = 0.8
"""Time in an episode at which the jump is requested, s; until then the robot settles."""
WATCHED = 3.5
"""Duration of an episode with one jump, s."""
REQUIRED_RISE = 0.15
"""Minimum rise of the trunk centre above the home pose in a successful jump, m."""


@dataclass(frozen=True)
class JumpOptions:
    """Options of the command `jump`: number of robots, and seed of their initial states."""

    robots: int = 256
    """Number of robots; each has a different random initial state."""
    seed: int = 0
    """Seed of the initial states, >= 0."""


@dataclass(frozen=True)
class JumpResult:
    """Result of the jumps of n robots, made by `run_jump`."""

    rise: Floats
    """Largest height of each robot's trunk centre above the home pose, (n,), m."""
    stands: NDArray[np.bool_]
    """True for robots that stand at the end of the episode, (n,), by `recovery.is_standing`."""
    peak_torque: float
    """Largest absolute joint torque over all robots, joints and control steps, N·m."""
    rated_torque: float
    """Rated torque of the robot's joints, N·m, for comparison with `peak_torque`."""
    diverged: int
    """Number of robots with a diverged simulation (numerically unstable state)."""


def main(options: JumpOptions) -> int:
    """Run the command `jump`: simulate jumps and print the result.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    check_numbers(options, {"robots": (1, 65_536), "seed": (0, 2**31)})
    print(format_result(run_jump(Behaviour(follow=False), episode_seeds("evaluation", options.seed, options.robots))))
    return 0


def run_jump(policy: Behaviour, seeds: NDArray[np.int64]) -> JumpResult:
    """Simulate one jump of each robot on flat ground.

    Args:
        policy: Policy that jumps on request.
        seeds: Seed of the initial state of each robot, (n,).

    Returns:
        Heights, final states and torques of the n robots.
    """
    robot = policy.robot
    period = policy.control_period
    peak_height = np.zeros(len(seeds))
    peak_torque = 0.0
    stands = diverged = np.zeros(len(seeds), np.bool_)

    def observe(step: Step) -> None:
        nonlocal peak_height, peak_torque, stands, diverged
        if step.number == round(SETTLING / period):
            policy.request("jump")
        peak_height = np.maximum(peak_height, step.infos["height"])
        peak_torque = max(peak_torque, float(np.abs(step.infos["joint_torque"]).max()))
        stands = is_standing(step.observation, step.infos)
        diverged = step.infos["diverged"]

    steps = round(WATCHED / period)
    roll_out(policy, "flat", seeds, observe, steps=steps, command=(0.0, 0.0, 0.0), terminate_on_fall=False)
    rise = peak_height - robot.home_height
    return JumpResult(rise, stands, peak_torque, robot.rated_torque, int(diverged.sum()))


def format_result(outcome: JumpResult) -> str:
    """Format the result of jumps as lines of text."""
    done = outcome.stands & (outcome.rise >= REQUIRED_RISE)
    return (
        f"rose {REQUIRED_RISE:g} m or more and landed standing: {done.sum()} of {len(done)}\n"
        f"rise: lowest {outcome.rise.min():.3f} m, median {np.median(outcome.rise):.3f} m\n"
        f"largest torque {outcome.peak_torque:.1f} N·m of {outcome.rated_torque:g}; {outcome.diverged} diverged"
    )
