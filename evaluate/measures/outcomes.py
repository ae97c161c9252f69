"""Outcome of an episode: whether the robot did what it was asked to do, and if not, what became of it.

By the rule `success/1` an episode succeeds if the robot neither fell nor diverged and in every command interval, after
its first second, its mean planar velocity was within 0.15 m/s + 20 % of the command, and its mean yaw rate within
0.15 rad/s + 20 %. A trace can be judged again by any of RULES.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.averages import Bools, Floats, planar, quotient

SUCCEEDED, OFF_COMMAND, REFUSED, FELL, DIVERGED = "succeeded", "off_command", "refused", "fell", "diverged"
OUTCOMES = (SUCCEEDED, OFF_COMMAND, REFUSED, FELL, DIVERGED)
"""Every outcome; an episode has exactly one."""
REFUSING = 0.25
"""Share of the commanded way below which an upright robot has refused it."""


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

    @property
    def words(self) -> str:
        """The rule in words."""
        if np.isinf(self.linear):
            return "upright to the end, whatever it was asked to do"
        share = f"{100.0 * self.share:g} % of the command"
        return (
            f"upright, and mean velocity within {self.linear:g} m/s + {share}, mean yaw rate within "
            f"{self.angular:g} rad/s + {share}, in every command interval after its first second"
        )

    def deviations(self, commands: Floats, velocities: Floats) -> Floats:
        """How far off its command each interval was, per what is allowed, by velocity or yaw rate, whichever is more.

        (n, k) for (n, k, 3) each, see `Measures`; NaN where the robot was not upright to the interval's end.
        """
        off = planar(velocities - commands), np.abs(velocities[..., 2] - commands[..., 2])
        allowed = (
            self.linear + self.share * planar(commands),
            self.angular + self.share * np.abs(commands[..., 2]),
        )
        return np.maximum(off[0] / allowed[0], off[1] / allowed[1])

    def on_command(self, commands: Floats, velocities: Floats) -> Bools:
        """Which episodes kept to their command in every interval, (n,); both (n, k, 3), see `Measures`."""
        return np.asarray((self.deviations(commands, velocities) <= 1.0).all(axis=1))


SUCCESS_RULE = "success/1"
"""The rule that an evaluation runs under."""
RULES = {
    rule.name: rule
    for rule in (
        SuccessRule(SUCCESS_RULE, linear=0.15, angular=0.15, share=0.2),
        SuccessRule("success-half", linear=0.075, angular=0.075, share=0.1),
        SuccessRule("success-double", linear=0.3, angular=0.3, share=0.4),
        SuccessRule("survival", linear=np.inf, angular=np.inf, share=0.0),
    )
}


def find(names: tuple[str, ...]) -> tuple[SuccessRule, ...]:
    """The rules of those names, every one for `all`; ValueError lists the valid names."""
    if names == ("all",):
        return tuple(RULES.values())
    if unknown := [name for name in names if name not in RULES]:
        raise ValueError(f"--success: unknown rule {unknown[0]!r}; valid: {', '.join(RULES)}, or all")
    return tuple(RULES[name] for name in names)


def outcomes(
    *,
    fell: Bools,
    diverged: Bools,
    stopped: Bools,
    failed: Bools | None = None,
    commands: Floats,
    velocities: Floats,
    durations: Floats | None = None,
    rule: SuccessRule = RULES[SUCCESS_RULE],
) -> NDArray[np.object_]:
    """Outcome of each episode, one of OUTCOMES, (n,).

    Args:
        fell: which ended by the fall rule or a divergence, (n,).
        diverged: which of them diverged, (n,).
        stopped: which a safety layer brought to a controlled stop, (n,); touching the ground then is no fall.
        failed: which the policy failed before any fall, (n,), such as by an exception; none by default.
        commands: of each command interval, (n, k, 3), forward m/s, lateral m/s, yaw rate rad/s.
        velocities: mean velocities of each interval after its first second, (n, k, 3), heading frame.
        durations: of the intervals, (k,); equal by default.
        rule: what counts as success.
    """
    kept = rule.on_command(commands, velocities)
    gone = share_of_way(commands, velocities, durations)
    out = np.full(len(fell), OFF_COMMAND, dtype=object)
    out[(gone < REFUSING) | stopped] = REFUSED
    out[kept] = SUCCEEDED
    out[fell & ~stopped] = FELL
    out[fell & stopped] = REFUSED
    if failed is not None:
        out[failed] = REFUSED
    out[diverged] = DIVERGED
    return out


def share_of_way(commands: Floats, velocities: Floats, durations: Floats | None = None) -> Floats:
    """Share of the commanded way that was gone along the commands, (n,); see `outcomes` for the arguments.

    Of an episode without a commanded way, that of the commanded turn; 1 where neither was commanded.
    """
    time = np.ones(commands.shape[1]) if durations is None else durations
    speed = planar(commands)
    along = quotient((commands[..., :2] * velocities[..., :2]).sum(axis=-1), speed)
    turned = np.sign(commands[..., 2]) * velocities[..., 2]
    way, turn = (speed * time).sum(axis=1), (np.abs(commands[..., 2]) * time).sum(axis=1)
    gone = quotient((np.nan_to_num(along) * time).sum(axis=1), way)
    gone = np.where(np.isnan(gone), quotient((turned * time).sum(axis=1), turn), gone)
    return np.where((way > 0.0) | (turn > 0.0), gone, 1.0)
