"""A test of walking: robots side by side, each held to a command on flat ground for some seconds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import HardwareConfig
from evaluate.measures.outcomes import RULES, SUCCESS_RULE
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from policies.base import Floats, Policy
from quad_env.config import FALL_REASONS
from quad_env.robots.similarity import scale_factor

Command = tuple[float, float, float]
UNITS, AXES = ("m/s", "m/s", "rad/s"), ("forward", "to the left", "of yaw rate")
SECONDS, SETTLING = 4.0, 2.0
"""Duration of a walk, and of its part that does not count."""


@dataclass(frozen=True)
class Walk:
    """What became of a robot that was held to a command."""

    command_name: str
    """The command in words, such as `forward`."""
    command: Floats
    """(3,), m/s and rad/s."""
    velocity: Floats
    """Mean, heading frame, (3,), m/s and rad/s."""
    fall: str
    """Why it fell; empty where it did not."""
    failure: str | None
    """Why the policy failed it; None where it did not."""
    errors: Floats
    """Of the velocity, per what the success rule allows, (3,); of turning at command zero none."""

    @property
    def deviation(self) -> float:
        """Largest of the errors; infinite after a fall or a failure. It follows its command at 1 and less."""
        return np.inf if self.fall or self.failure else float(self.errors.max())

    @property
    def description(self) -> str:
        """Such as `forward 0.49 of 0.50 m/s`."""
        if self.failure:
            return f"commanded {self.command_name} it {self.failure}"
        if self.fall:
            return f"commanded {self.command_name} it falls ({self.fall.replace('_', ' ')})"
        if not self.command.any():
            return f"commanded {self.command_name} it moves at {np.linalg.norm(self.velocity[:2]):.2f} m/s"
        axis, worst = int(np.abs(self.command).argmax()), int(self.errors.argmax())
        words = f"{self.command_name} {_rounded(self.velocity[axis])} of {self.command[axis]:.2f} {UNITS[axis]}"
        if self.deviation <= 1.0 or worst == axis:
            return words
        return f"{words}, with {_rounded(self.velocity[worst])} {UNITS[worst]} {AXES[worst]}"


def walks(
    policy: Policy,
    hardware: HardwareConfig,
    commands: Mapping[str, Command],
    seeds: NDArray[np.int64],
    copies: int = 1,
    shortened_by: float = 1.0,
) -> list[Walk]:
    """Return a walk for each seed and each command, by the command's words.

    Args:
        policy: Whom the robots follow.
        hardware: Of the robots.
        commands: SimpleQuad's, m/s and rad/s, scaled to the size of the robot.
        seeds: Of the episodes.
        times: Number of repetitions of all walks, one for each policy of a stack.
        shortened_by: Factor by which the walks are shorter than SECONDS.

    Raises:
        ValueError: What making the environment and `Policy.check_fits` raise.
    """
    scale, count = np.array([scale_factor(policy.robot, unit) for unit in UNITS]), len(seeds)
    asked = np.tile(np.repeat(scale * np.array(list(commands.values())), count, axis=0), (copies, 1))
    fall = np.zeros(len(asked), int)
    velocities: list[Floats] = []

    def observe(step: Step) -> None:
        fall[:] = np.where(fall > 0, fall, step.infos["fall"])
        if step.number * step.env.dt > SETTLING / shortened_by:
            velocities.append(step.infos["heading_velocity"])

    steps = round(SECONDS / shortened_by / policy.control_period)
    seeds = np.tile(seeds, len(commands) * copies)
    roll_out(policy, "flat", seeds, observe, steps=steps, command=asked, hardware=hardware)
    planar = np.linalg.norm(asked[:, :2], axis=1, keepdims=True)
    rule = RULES[SUCCESS_RULE]
    allowed = rule.linear * scale + rule.share * np.hstack((planar, planar, np.abs(asked[:, 2:])))
    means = np.mean(velocities, axis=0) if velocities else np.zeros_like(asked)
    errors = np.abs(means - asked) / allowed
    errors[:, 2] *= asked.any(axis=1)  # many turn a little where they are to stand
    ways = np.tile(np.repeat(list(commands), count), copies).tolist()
    falls = [FALL_REASONS[code] if code else "" for code in fall]
    failures = getattr(policy, "failure", None)
    failures = [None] * len(asked) if failures is None else failures
    return [Walk(*each) for each in zip(ways, asked, means, falls, failures, errors, strict=True)]


def _rounded(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:.2f}"  # no −0
