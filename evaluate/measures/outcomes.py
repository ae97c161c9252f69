"""Outcome of an episode: whether the robot did what it was asked to do, and if not, what became of it.

RULES say what success is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, planar, quotient

SUCCEEDED, OFF_COMMAND, STALLED, POLICY_ERROR = "succeeded", "off_command", "stalled", "policy_error"
FELL, DIVERGED = "fell", "diverged"
OUTCOMES = (SUCCEEDED, OFF_COMMAND, STALLED, POLICY_ERROR, FELL, DIVERGED)
"""Every outcome; an episode has exactly one."""
MIN_PROGRESS = 0.25
"""Share of the commanded distance below which an upright robot has stalled."""
MOVING = 0.05
"""Commanded planar speed, m/s, above which a stalled interval is no success, whatever the tolerance."""


@dataclass(frozen=True)
class SuccessRule:
    """How far an upright robot may be off its command and still succeed."""

    name: str
    linear: float
    """Planar velocity, m/s."""
    angular: float
    """Yaw rate, rad/s."""
    share: float
    """Of the commanded planar velocity, or of the commanded yaw rate, on top of that."""
    stalls: bool = True
    """Whether a stalled interval is no success, though it is within tolerance."""
    of_steps: bool = False
    """Whether the tolerances are of the mean error of the episode's steps, and not of each interval's mean velocity."""

    @property
    def description(self) -> str:
        """The rule in words."""
        if np.isinf(self.linear):
            return "upright to the end, whatever it was asked to do"
        if self.of_steps:
            return (
                f"upright to the end, and mean velocity error of the steps below {self.linear:g} m/s, mean yaw-rate "
                f"error below {self.angular:g} rad/s, after the first second"
            )
        share = f"{100.0 * self.share:g} % of the command"
        moved = (
            f"; and at least {100.0 * MIN_PROGRESS:g} % of the commanded distance, along the command, in every "
            f"interval that commands more than {MOVING:g} m/s"
        )
        return (
            f"upright, and mean velocity within {self.linear:g} m/s + {share}, mean yaw rate within "
            f"{self.angular:g} rad/s + {share}, in every command interval after its first second{moved * self.stalls}"
        )

    def deviations(self, commands: Floats, velocities: Floats) -> Floats:
        """How far off its command each interval was, per what is allowed, by velocity or yaw rate, whichever is more.

        (n, k) for (n, k, 3) each, see `Measures`; NaN where the robot was not upright to the interval's end.
        """
        off = planar(velocities - commands), np.abs(velocities[..., 2] - commands[..., 2])
        allowed = (self.linear + self.share * planar(commands), self.angular + self.share * np.abs(commands[..., 2]))
        return np.maximum(off[0] / allowed[0], off[1] / allowed[1])

    def stalled(self, commands: Floats, velocities: Floats) -> Bools:
        """Which intervals are no success because the robot hardly moved in them, (n, k); both (n, k, 3)."""
        speed = planar(commands)
        along = quotient((commands[..., :2] * velocities[..., :2]).sum(axis=-1), speed)
        return np.asarray(self.stalls & (speed > MOVING) & (along < MIN_PROGRESS * speed))

    def on_command(self, commands: Floats, velocities: Floats, errors: Floats | None = None) -> Bools:
        """Which episodes followed their command, (n,); commands and velocities (n, k, 3), see `Measures`.

        `errors` are mean velocity error, m/s, and mean yaw-rate error, rad/s, of each episode's steps, (n, 2); None
        where they are not known, which a rule of steps lets nothing pass with.
        """
        if self.of_steps:
            return np.asarray((np.asarray(errors, np.float64) < (self.linear, self.angular)).all(axis=-1))
        within = self.deviations(commands, velocities) <= 1.0
        return np.asarray((within & ~self.stalled(commands, velocities)).all(axis=1))


SUCCESS_RULE = "success/2"
"""The rule that an evaluation runs under."""
ISAAC_LAB = "isaac-lab"
"""Thresholds of Isaac Lab's `Metrics/success_rate` for quadrupeds: `vel_xy_success_threshold` and
`vel_yaw_success_threshold` of `UniformVelocityCommandCfg`, isaac-sim/IsaacLab#5415.

There the errors are of the steps up to the end of the episode, in the body frame, so that a robot that falls can
succeed; here a fall is a failure, velocities are in the heading frame, and the first second does not count."""
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


def outcomes(
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
    """Outcome of each episode, one of OUTCOMES, (n,).

    Args:
        fell: which ended by the fall rule or a divergence, (n,).
        diverged: which of them diverged, (n,).
        stopped: which a safety layer brought to a controlled stop, (n,); touching the ground then is no fall.
        failed: which the policy failed before any fall, (n,), such as by an exception.
        commands: of each command interval, (n, k, 3), forward m/s, lateral m/s, yaw rate rad/s.
        velocities: mean velocities of each interval after its first second, (n, k, 3), heading frame.
        errors: see `SuccessRule.on_command`.
        durations: of the intervals, (k,).
        rule: what counts as success.
    """
    stalled = rule.stalled(commands, velocities).any(axis=1)
    stalled |= commanded_progress(commands, velocities, durations) < MIN_PROGRESS
    out = np.full(len(fell), OFF_COMMAND, dtype=object)
    out[stalled | stopped] = STALLED
    out[rule.on_command(commands, velocities, errors)] = SUCCEEDED
    out[fell & ~stopped] = FELL
    out[fell & stopped] = STALLED
    out[failed] = POLICY_ERROR
    out[diverged] = DIVERGED
    return out


def commanded_progress(commands: Floats, velocities: Floats, durations: Floats) -> Floats:
    """Share of the commanded way that was gone along the commands, (n,); see `outcomes` for the arguments.

    Of an episode without a commanded way, that of the commanded turn; 1 where neither was commanded.
    """
    speed = planar(commands)
    along = quotient((commands[..., :2] * velocities[..., :2]).sum(axis=-1), speed)
    turned = np.sign(commands[..., 2]) * velocities[..., 2]
    way, turn = (speed * durations).sum(axis=1), (np.abs(commands[..., 2]) * durations).sum(axis=1)
    gone = quotient((np.nan_to_num(along) * durations).sum(axis=1), way)
    gone = np.where(np.isnan(gone), quotient((turned * durations).sum(axis=1), turn), gone)
    return np.where((way > 0.0) | (turn > 0.0), gone, 1.0)
