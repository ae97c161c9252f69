"""All measures of recorded episodes; unit, frame and formula are in `evaluate.measures.catalogue`.

The first second of an episode does not enter the measures. A control step is *upright* if its signals were recorded
before the robot fell or the simulation diverged; later steps do not enter the measures. Signals are recorded in single
precision and evaluated in double precision.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures import tracking
from evaluate.measures.at_rest import controlled_stops
from evaluate.measures.averages import Bools, Floats, upright_steps
from evaluate.measures.effort import cost_of_all, effort
from evaluate.measures.episodes import Episodes
from evaluate.measures.extra import compute_extra
from evaluate.measures.gait_quality import gait
from evaluate.measures.outcomes import RULES, STALLED, SUCCEEDED, SUCCESS_RULE, SuccessRule, outcomes
from evaluate.measures.pushes import pushes


@dataclass(frozen=True)
class Measures:
    """Measures of n episodes; each is an array, (n, …), with NaN for episodes in which it is not defined.

    Unit, frame and formula of each measure are in `evaluate.measures.catalogue`.
    """

    outcome: NDArray[np.object_]
    fell: Bools
    diverged: Bools
    fall_time: Floats
    velocity_error: Floats
    yaw_rate_error: Floats
    mean_velocity_error: Floats
    velocity_error_upright: Floats
    fall_after_push: Floats
    energy: Floats
    positive_work: Floats
    regeneration: Floats
    joule_heat: Floats
    distance: Floats
    cost_of_transport: Floats
    mechanical_power: Floats
    peak_torque: Floats
    mean_torque: Floats
    torque_share: Floats
    speed_share: Floats
    torque_rate: Floats
    overspeed: Floats
    action_rate: Floats
    foot_slip: Floats
    step_rate: Floats
    touchdown_impulse: Floats
    flight: Floats
    trunk_height: Floats
    duty_factor: Floats
    """Duty factor (fraction of time in stance) of each foot, order FL, FR, RL, RR, (n, 4)."""
    commands: Floats
    """Command of each of k intervals of constant command, (n, k, 3): forward and lateral m/s, yaw rate rad/s.

    The command is in the heading frame. It is NaN if the robot had fallen before the start of the interval.
    """
    mean_velocities: Floats
    """Mean velocity in each of k command intervals, (n, k, 3): forward and lateral m/s, yaw rate rad/s.

    The velocity is in the heading frame. It is NaN if the robot had fallen before the end of the interval.
    """
    push_time: Floats
    """Time at which each of k pushes begins, (n, k), s."""
    push_impulse: Floats
    """Impulse of each of k pushes, heading frame just before the push, x and y, (n, k, 2), N·s."""
    push_fell: Floats
    """1 if a fall is attributed to the push, otherwise 0, for each of k pushes, (n, k); NaN after a fall."""
    cause: NDArray[np.object_]
    """Name of the cause of failure in each episode, for example `trip`, (n,).

    It is None if the episode succeeded, or if the cause is not known.
    """
    cause_time: Floats
    cause_detail: NDArray[np.object_]
    extra: Mapping[str, Floats] = field(default_factory=dict)
    """Name of a measure that an extension has registered -> value of each episode, (n,)."""

    @property
    def succeeded(self) -> Bools:
        """True for episodes with the outcome `succeeded`, (n,)."""
        return np.asarray(self.outcome == SUCCEEDED)

    @property
    def stalled(self) -> Bools:
        """True for episodes with the outcome `stalled` (too little progress, or a controlled stop), (n,)."""
        return np.asarray(self.outcome == STALLED)


MEASURE_NAMES = tuple(each.name for each in fields(Measures) if each.name != "extra")
"""Names of all measures that this project defines; measures of extensions are not included."""


def measure(episodes: Episodes) -> Measures:
    """Compute all measures of recorded episodes except the causes of failure.

    The function `evaluate.causes.verdict.with_causes` adds the causes of failure to the measures.
    """
    upright = upright_steps(episodes.fall_step, episodes.steps)
    fell = episodes.fall_step < episodes.steps
    unknown = np.full(episodes.count, None, dtype=object)
    tracking_measures, distance = _tracking(episodes, upright)
    return Measures(
        outcome=outcome(episodes, tracking_measures=tracking_measures),
        fell=fell,
        diverged=episodes.diverged,
        fall_time=np.where(fell, (episodes.fall_step + 1) * episodes.dt, np.nan),
        distance=distance,
        **tracking_measures,
        **effort(episodes, upright, distance),
        **gait(episodes, upright),
        **pushes(episodes),
        cause=unknown,
        cause_time=np.full(episodes.count, np.nan),
        cause_detail=unknown,
        extra=compute_extra(episodes),
    )


def outcome(
    episodes: Episodes, rule: SuccessRule = RULES[SUCCESS_RULE], tracking_measures: dict[str, Floats] | None = None
) -> NDArray[np.object_]:
    """Determine the outcome of each episode, for example `succeeded` or `fell`, by a success rule.

    Args:
        episodes: Recorded episodes.
        rule: Success rule, with tolerances for the velocity errors.
        tracking_measures: Name -> measure of command tracking; None to compute these measures from the episodes.

    Returns:
        Name of the outcome of each episode, one of OUTCOMES, (n,).
    """
    upright = upright_steps(episodes.fall_step, episodes.steps)
    if not tracking_measures:
        tracking_measures, _ = _tracking(episodes, upright)
    fell = episodes.fall_step < episodes.steps
    stopped = np.zeros(episodes.count, np.bool_)
    if episodes.stopped is not None:
        stopped = (episodes.stopped & upright).any(axis=0) & (~fell | controlled_stops(episodes))
    return outcomes(
        fell=fell,
        diverged=episodes.diverged,
        stopped=stopped,
        failed=episodes.failed,
        commands=tracking_measures["commands"],
        velocities=tracking_measures["mean_velocities"],
        errors=np.stack([tracking_measures["velocity_error"], tracking_measures["yaw_rate_error"]], axis=-1),
        durations=np.array([window.stop - window.start for window in episodes.intervals.settled], np.float64),
        rule=rule,
    )


def summarise(episodes: Episodes) -> dict[str, float]:
    """Compute the metrics with which training validates a policy: name -> one value for all `episodes`."""
    measures = measure(episodes)
    means = ("velocity_error", "yaw_rate_error", "mean_velocity_error", "energy")
    return {
        "success_rate": float(measures.succeeded.mean()),
        "fall_rate": float(measures.fell.mean()),
        "diverged_rate": float(measures.diverged.mean()),
        **{name: float(getattr(measures, name).mean()) for name in means},
        "cost_of_transport": cost_of_all(measures.energy, measures.distance, episodes.weight),
    }


def _tracking(episodes: Episodes, upright: Bools) -> tuple[dict[str, Floats], Floats]:
    """Compute the measures of command tracking and the covered distance.

    Args:
        episodes: Recorded episodes.
        upright: True for control steps before the robot's fall, (steps, n).

    Returns:
        measures: Name of the measure -> value of each episode, (n, …).
        distance: Distance that the robot covered in each episode, (n,), m.
    """
    settling = episodes.settling
    intervals = episodes.intervals
    windows = intervals.settled
    command = episodes.command.astype(np.float64)
    velocity = episodes.heading_velocity.astype(np.float64)
    settled: dict[str, Any] = {
        "command": command[settling:],
        "velocity": velocity[settling:],
        "upright": upright[settling:],
    }
    measures = {
        "velocity_error": tracking.velocity_error(**settled),
        "yaw_rate_error": tracking.yaw_rate_error(**settled),
        "velocity_error_upright": tracking.velocity_error_upright(**settled),
        "mean_velocity_error": tracking.mean_velocity_error(command, velocity, upright, windows),
        "commands": tracking.commands_given(command, upright, tuple(window.start - settling for window in windows)),
        "mean_velocities": tracking.mean_velocities(velocity, upright, windows),
    }
    return measures, tracking.distance_covered(velocity, upright, intervals.travelled, episodes.dt)
