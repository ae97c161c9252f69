"""Walking test: several robots, each with a constant command on flat ground for a few seconds."""

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
"""Commanded forward velocity, lateral velocity and yaw rate, m/s, m/s, rad/s."""
UNITS = ("m/s", "m/s", "rad/s")
AXES = ("forward", "to the left", "of yaw rate")
WALK_TIME = 4.0
"""Duration of a walk, s."""
SETTLING_TIME = 2.0
"""Time at the start of a walk that does not count, s."""


@dataclass(frozen=True)
class Walk:
    """Result of a robot's walk with a constant command."""

    command_name: str
    """Name of the command, for example `forward`."""
    command: Floats
    """Commanded velocity, heading frame, (3,), m/s and rad/s."""
    velocity: Floats
    """Mean velocity, heading frame, (3,), m/s and rad/s."""
    fall: str
    """Name of the fall rule; empty if the robot did not fall."""
    failure: str | None
    """Reason for the policy's failure; None if the policy did not fail."""
    errors: Floats
    """Velocity errors divided by the tolerances of the success rule, (3,).

    The yaw-rate error is 0 if the robot is commanded to stand.
    """

    @property
    def deviation(self) -> float:
        """Largest error, at most 1 if the robot follows its command; infinite after a fall or a failure."""
        return np.inf if self.fall or self.failure else float(self.errors.max())

    @property
    def description(self) -> str:
        """Description of the walk, for example `forward 0.49 of 0.50 m/s`."""
        if self.failure:
            return f"commanded {self.command_name} it {self.failure}"
        if self.fall:
            return f"commanded {self.command_name} it falls ({self.fall.replace('_', ' ')})"
        if not self.command.any():
            return f"commanded {self.command_name} it moves at {np.linalg.norm(self.velocity[:2]):.2f} m/s"
        commanded = int(np.abs(self.command).argmax())
        worst = int(self.errors.argmax())
        text = (
            f"{self.command_name} {_format(self.velocity[commanded])} of {self.command[commanded]:.2f} "
            f"{UNITS[commanded]}"
        )
        if self.deviation <= 1.0 or worst == commanded:
            return text
        return f"{text}, with {_format(self.velocity[worst])} {UNITS[worst]} {AXES[worst]}"


def run_walks(
    policy: Policy,
    hardware: HardwareConfig,
    commands: Mapping[str, Command],
    seeds: NDArray[np.int64],
    copies: int = 1,
    shortened_by: float = 1.0,
) -> list[Walk]:
    """Run a walk for each command and seed.

    Args:
        policy: Policy of all robots.
        hardware: Hardware of the robots.
        commands: Name -> command for SimpleQuad, m/s and rad/s. It is scaled to the size of the robot.
        seeds: Seeds of the episodes, (k,).
        copies: Number of repetitions of all walks, one for each policy of a stack.
        shortened_by: Divisor of WALK_TIME and SETTLING_TIME.

    Returns:
        Walks, sorted by copy, then by command, then by seed. Raises ValueError if the policy was made for another
        robot or control period.
    """
    scale = np.array([scale_factor(policy.robot, unit) for unit in UNITS])
    command = np.tile(np.repeat(scale * np.array(list(commands.values())), len(seeds), axis=0), (copies, 1))
    names = np.tile(np.repeat(list(commands), len(seeds)), copies).tolist()
    fall = np.zeros(len(command), int)
    velocities: list[Floats] = []

    def observe(step: Step) -> None:
        fall[:] = np.where(fall > 0, fall, step.infos["fall"])
        if step.number * step.env.dt > SETTLING_TIME / shortened_by:
            velocities.append(step.infos["heading_velocity"])

    roll_out(
        policy,
        "flat",
        np.tile(seeds, len(commands) * copies),
        observe,
        steps=round(WALK_TIME / shortened_by / policy.control_period),
        command=command,
        hardware=hardware,
    )
    velocity = np.mean(velocities, axis=0) if velocities else np.zeros_like(command)
    errors = _relative_errors(command, velocity, scale)
    reasons = [FALL_REASONS[code] if code else "" for code in fall]
    failures = getattr(policy, "failure", None)
    failures = [None] * len(command) if failures is None else failures
    return [Walk(*row) for row in zip(names, command, velocity, reasons, failures, errors, strict=True)]


def _relative_errors(command: Floats, velocity: Floats, scale: Floats) -> Floats:
    """Return the errors of mean velocities divided by the tolerances of the success rule, (n, 3)."""
    planar = np.linalg.norm(command[:, :2], axis=1, keepdims=True)
    rule = RULES[SUCCESS_RULE]
    tolerance = rule.linear * scale + rule.share * np.hstack((planar, planar, np.abs(command[:, 2:])))
    errors = np.abs(velocity - command) / tolerance
    errors[:, 2] *= command.any(axis=1)  # 0 at command zero, because many policies turn a little while standing
    return errors


def _format(value: float) -> str:
    """Format a number with two decimals; a negative zero becomes `0.00`."""
    return f"{round(float(value), 2) + 0.0:.2f}"
