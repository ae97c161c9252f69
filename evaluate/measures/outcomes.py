"""Outcome of an episode: success by one of several success rules, or the kind of failure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, planar, quotient

SUCCEEDED = "succeeded"
OFF_COMMAND = "off_command"
STALLED = "stalled"
POLICY_ERROR = "policy_error"
FELL = "fell"
DIVERGED = "diverged"
OUTCOMES = (SUCCEEDED, OFF_COMMAND, STALLED, POLICY_ERROR, FELL, DIVERGED)
"""Names of all outcomes; each episode has exactly one."""
MIN_PROGRESS = 0.25
"""Minimum progress: fraction of the commanded distance that a robot must cover in the commanded direction.

An episode has the outcome `stalled` if the upright robot makes less progress in the whole episode, or in an interval of
constant command.
"""
MOVING = 0.05
"""Commanded planar speed above which the robot must make a minimum progress (MIN_PROGRESS), m/s.

In intervals with a lower commanded speed, only the tolerances of the success rule decide about success.
"""


@dataclass(frozen=True)
class SuccessRule:
    """Success rule: tolerances for the velocity errors of a robot that stays upright to the end."""

    name: str
    linear: float
    """Tolerance of the planar velocity error, m/s."""
    angular: float
    """Tolerance of the yaw-rate error, rad/s."""
    share: float
    """Fraction of the commanded planar speed, and of the commanded yaw rate, that is added to its tolerance."""
    stalls: bool = True
    """True if an episode fails when the robot covers too little of the commanded distance in a command interval.

    The robot must cover at least the fraction MIN_PROGRESS, even if the velocity error is within the tolerances.
    """
    of_steps: bool = False
    """True if the tolerances apply to the mean error over the control steps of an episode.

    If it is False, the tolerances apply to the error of the mean velocity in each interval of constant command.
    """

    @property
    def description(self) -> str:
        """Description of the success rule in words, for reports."""
        if np.isinf(self.linear):
            return "upright to the end, whatever it was asked to do"
        if self.of_steps:
            return (
                f"upright to the end, and mean velocity error of the steps below {self.linear:g} m/s, mean yaw-rate "
                f"error below {self.angular:g} rad/s, after the first second"
            )
        share = f"{100.0 * self.share:g} % of the command"
        progress = ""
        if self.stalls:
            progress = (
                f"; and at least {100.0 * MIN_PROGRESS:g} % of the commanded distance, along the command, in every "
                f"interval that commands more than {MOVING:g} m/s"
            )
        return (
            f"upright, and mean velocity within {self.linear:g} m/s + {share}, mean yaw rate within "
            f"{self.angular:g} rad/s + {share}, in every command interval after its first second{progress}"
        )

    def deviations(self, commands: Floats, velocities: Floats) -> Floats:
        """Return the relative velocity error of each interval of constant command: error / tolerance.

        It is the larger one of two relative errors: of the planar velocity and of the yaw rate.

        Args:
            commands: Command of each of k intervals of constant command, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.
            velocities: Mean velocity of the trunk in each interval, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.

        Returns:
            Relative error, (n, k), at most 1 within the tolerance; NaN if the robot had fallen before the interval's
            end.
        """
        velocity_error = planar(velocities - commands)
        yaw_rate_error = np.abs(velocities[..., 2] - commands[..., 2])
        velocity_tolerance = self.linear + self.share * planar(commands)
        yaw_rate_tolerance = self.angular + self.share * np.abs(commands[..., 2])
        return np.maximum(velocity_error / velocity_tolerance, yaw_rate_error / yaw_rate_tolerance)

    def stalled(self, commands: Floats, velocities: Floats) -> Bools:
        """Return True for command intervals in which the robot stalls, that is, covers too little distance.

        The robot stalls if its speed along the command is below MIN_PROGRESS times the commanded speed. The result is
        False for intervals with a commanded planar speed of at most MOVING (nearly standing).

        Args:
            commands: Command of each of k intervals of constant command, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.
            velocities: Mean velocity of the trunk in each interval, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.

        Returns:
            True for intervals in which the robot stalls, (n, k); all False if `stalls` is False.
        """
        speed = planar(commands)
        along = quotient((commands[..., :2] * velocities[..., :2]).sum(axis=-1), speed)
        return np.asarray(self.stalls & (speed > MOVING) & (along < MIN_PROGRESS * speed))

    def on_command(self, commands: Floats, velocities: Floats, errors: Floats | None = None) -> Bools:
        """Return True for episodes in which the robot followed its commands within the tolerances.

        Args:
            commands: Command of each of k intervals of constant command, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.
            velocities: Mean velocity of the trunk in each interval, heading frame, (n, k, 3): forward and lateral
                velocity, m/s, and yaw rate, rad/s.
            errors: Mean planar velocity error and mean yaw-rate error over the control steps of each episode, (n, 2),
                m/s, rad/s. A rule with `of_steps` rejects every episode if `errors` is None.

        Returns:
            True for episodes in which the robot followed its commands, (n,).
        """
        if self.of_steps:
            return np.asarray((np.asarray(errors, np.float64) < (self.linear, self.angular)).all(axis=-1))
        within = self.deviations(commands, velocities) <= 1.0
        return np.asarray((within & ~self.stalled(commands, velocities)).all(axis=1))


SUCCESS_RULE = "success/2"
"""Name of the success rule that evaluations use unless the user selects another one."""
ISAAC_LAB = "isaac-lab"
"""Name of the success rule with the thresholds of Isaac Lab's `Metrics/success_rate` for quadrupeds.

The thresholds are `vel_xy_success_threshold` and `vel_yaw_success_threshold` of `UniformVelocityCommandCfg`,
isaac-sim/IsaacLab#5415. Isaac Lab averages the errors in the body frame up to the end of the episode, so a robot that
falls can succeed. In this project a fall is a failure, velocities are in the heading frame, and the first second is
excluded from the errors.
"""
RULES = {
    rule.name: rule
    for rule in (
        SuccessRule(SUCCESS_RULE, linear=0.15, angular=0.15, share=0.2),
        SuccessRule("success-half", linear=0.075, angular=0.075, share=0.1),
        SuccessRule("success-double", linear=0.3, angular=0.3, share=0.4),
        SuccessRule("survival", linear=np.inf, angular=np.inf, share=0.0, stalls=False),
        SuccessRule(ISAAC_LAB, linear=0.5, angular=0.4, share=0.0, stalls=False, of_steps=True),
    )
}


def outcomes(  # noqa: PLR0913 -- arrays of one kind, by keyword alone
    *,
    fell: Bools,
    diverged: Bools,
    stopped: Bools,
    failed: Bools,
    commands: Floats,
    velocities: Floats,
    errors: Floats | None = None,
    durations: Floats,
    rule: SuccessRule = RULES[SUCCESS_RULE],
) -> NDArray[np.object_]:
    """Determine the outcome of each episode, for example `succeeded`, `stalled` or `fell`.

    Args:
        fell: True if the episode ended by the fall rule or a divergence of the simulation, (n,).
        diverged: True if the episode ended by a divergence of the simulation, (n,).
        stopped: True if a safety layer brought the robot to a controlled stop, (n,). The outcome is then `stalled`
            rather than `fell`.
        failed: True if the policy failed before a fall, for example by an exception, (n,).
        commands: Command of each of k intervals of constant command, heading frame, (n, k, 3): forward and lateral
            velocity, m/s, and yaw rate, rad/s.
        velocities: Mean velocity of the trunk in each interval, heading frame, (n, k, 3): forward and lateral velocity,
            m/s, and yaw rate, rad/s.
        errors: Mean errors over the control steps of each episode, (n, 2), as for `SuccessRule.on_command`.
        durations: Duration of each interval, (k,), in control steps.
        rule: Success rule, with the tolerances.

    Returns:
        Name of the outcome of each episode, one of OUTCOMES, (n,).
    """
    stalled = rule.stalled(commands, velocities).any(axis=1)
    stalled |= commanded_progress(commands, velocities, durations) < MIN_PROGRESS
    outcome = np.full(len(fell), OFF_COMMAND, dtype=object)
    outcome[stalled | stopped] = STALLED
    outcome[rule.on_command(commands, velocities, errors)] = SUCCEEDED
    outcome[fell & ~stopped] = FELL
    outcome[fell & stopped] = STALLED
    outcome[failed] = POLICY_ERROR
    outcome[diverged] = DIVERGED
    return outcome


def commanded_progress(commands: Floats, velocities: Floats, durations: Floats) -> Floats:
    """Return the progress of each episode: distance along the commands / commanded distance.

    Args:
        commands: Command of each of k intervals of constant command, heading frame, (n, k, 3): forward and lateral
            velocity, m/s, and yaw rate, rad/s.
        velocities: Mean velocity of the trunk in each interval, heading frame, (n, k, 3): forward and lateral velocity,
            m/s, and yaw rate, rad/s.
        durations: Duration of each interval, (k,), in any unit.

    Returns:
        Progress, (n,), dimensionless. If no distance is commanded, it is the fraction of the commanded turn. If no turn
        is commanded either, it is 1.
    """
    speed = planar(commands)
    along = quotient((commands[..., :2] * velocities[..., :2]).sum(axis=-1), speed)
    turned = np.sign(commands[..., 2]) * velocities[..., 2]
    distance = (speed * durations).sum(axis=1)
    turn = (np.abs(commands[..., 2]) * durations).sum(axis=1)
    progress = quotient((np.nan_to_num(along) * durations).sum(axis=1), distance)
    progress = np.where(np.isnan(progress), quotient((turned * durations).sum(axis=1), turn), progress)
    return np.where((distance > 0.0) | (turn > 0.0), progress, 1.0)
