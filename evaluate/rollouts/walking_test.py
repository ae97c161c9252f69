"""Walking test: robots walk on flat ground for a few seconds, each with a constant command."""

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
"""Command: forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s, heading frame."""
UNITS = ("m/s", "m/s", "rad/s")
AXES = ("forward", "to the left", "of yaw rate")
WALK_TIME = 4.0
"""Duration of a test walk, s."""
SETTLING_TIME = 2.0
"""Time at the start of a test walk that does not enter the mean velocity, s."""


@dataclass(frozen=True)
class Walk:
    """Result of a test walk of one robot with a constant command."""

    command_name: str
    """Name of the command, for example `forward`."""
    command: Floats
    """Commanded forward and lateral velocity, m/s, and yaw rate, rad/s, heading frame, (3,)."""
    velocity: Floats
    """Mean forward and lateral velocity, m/s, and yaw rate, rad/s, after the settling time, heading frame, (3,)."""
    fall: str
    """Reason of the fall that ended the walk, for example `trunk_contact`; empty if the robot did not fall."""
    failure: str | None
    """Error with which the policy failed, as text; None if the policy did not fail."""
    errors: Floats
    """Absolute errors of the mean velocities and yaw rate, divided by the tolerances of the success rule, (3,).

    The error of the yaw rate is 0 if the robot is commanded to stand.
    """

    @property
    def deviation(self) -> float:
        """Largest component of `errors`, which is at most 1 if the robot follows its command.

        The deviation is infinite if the robot fell or the policy failed.
        """
        return np.inf if self.fall or self.failure else float(self.errors.max())

    @property
    def description(self) -> str:
        """Description of the walk as text, for example `forward 0.49 of 0.50 m/s`."""
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
    """Run a test walk for each command and each seed.

    ValueError is raised if the policy was made for another robot or control period.

    Args:
        policy: Policy that controls all robots.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.
        commands: Name -> command for SimpleQuad: forward and lateral velocity, m/s, and yaw rate, rad/s. The commands
            are scaled to the size of the robot.
        seeds: Seeds of the episodes, (k,).
        copies: Number of repetitions of all walks. If several policies are tested together, each policy controls one
            repetition.
        shortened_by: Divisor of the duration of a walk and of its settling time.

    Returns:
        Results of the walks, sorted by repetition, then by command, then by seed.
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
    """Return absolute errors of mean velocities and yaw rates, divided by the success rule's tolerances.

    Args:
        command: Commands, heading frame, (n, 3): forward and lateral velocity, m/s, and yaw rate, rad/s.
        velocity: Mean velocities of the trunk, heading frame, (n, 3): forward and lateral velocity, m/s, and yaw rate,
            rad/s.
        scale: Factors on the three tolerances for the size of the robot, (3,).

    Returns:
        Relative errors, (n, 3); the error of the yaw rate is 0 if the command is to stand.
    """
    planar = np.linalg.norm(command[:, :2], axis=1, keepdims=True)
    rule = RULES[SUCCESS_RULE]
    tolerance = rule.linear * scale + rule.share * np.hstack((planar, planar, np.abs(command[:, 2:])))
    errors = np.abs(velocity - command) / tolerance
    # The error of the yaw rate is 0 if the command is to stand, because many policies then turn a little.
    errors[:, 2] *= command.any(axis=1)
    return errors


def _format(value: float) -> str:
    """Format a number with two decimals; a negative zero becomes `0.00`, not `-0.00`."""
    return f"{round(float(value), 2) + 0.0:.2f}"
