"""Every measure of a set of episodes; what each means, its unit and its formula stand in `evaluate.measures.catalogue`.

They look at the control steps after an episode's first second. A step is *upright* if its reading was taken before the
robot fell or diverged; nothing that was recorded later counts, whatever it is. Arithmetic is in double precision, on
what was recorded in single precision.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
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
    """What n episodes measured; one entry an episode, NaN where it does not exist; see `catalogue`."""

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
    """(n, 4)"""
    commands: Floats
    """(n, k, 3), k command intervals; NaN where the robot was not upright to begin it."""
    mean_velocities: Floats
    """(n, k, 3); NaN where the robot was not upright to its end."""
    push_time: Floats
    """(n, k), k pushes, as are the next two."""
    push_impulse: Floats
    """(n, k, 2)"""
    push_fell: Floats
    cause: NDArray[np.object_]
    """Why each episode failed, one of `evaluate.causes.rules.CAUSES`; None of a success, and where it is not known."""
    cause_time: Floats
    cause_detail: NDArray[np.object_]
    extra: Mapping[str, Floats] = field(default_factory=dict)
    """Measures of extensions by name, (n,) each."""

    @property
    def succeeded(self) -> Bools:
        """Which episodes succeeded, (n,)."""
        return np.asarray(self.outcome == SUCCEEDED)

    @property
    def stalled(self) -> Bools:
        """Which episodes stalled, (n,)."""
        return np.asarray(self.outcome == STALLED)


def measure(episodes: Episodes) -> Measures:
    """Every measure of a set of episodes but the causes of failures, see `evaluate.causes.verdict`."""
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
    """What came of each episode under a rule of success, one of OUTCOMES, (n,); `following` are its measures
    of tracking where they are known."""
    upright = upright_steps(episodes.fall_step, episodes.steps)
    tracking_measures = tracking_measures or _tracking(episodes, upright)[0]
    fell, stopped = episodes.fall_step < episodes.steps, np.zeros(episodes.count, np.bool_)
    if episodes.stopped is not None:
        controlled = controlled_stops(episodes)
        stopped = (episodes.stopped & upright).any(axis=0) & (~fell | controlled)
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
    """Plain means over a set of episodes, name -> value, and their cost of transport together: what training validates
    with."""
    measures, means = measure(episodes), ("velocity_error", "yaw_rate_error", "mean_velocity_error", "energy")
    return {
        "success_rate": float(measures.succeeded.mean()),
        "fall_rate": float(measures.fell.mean()),
        "diverged_rate": float(measures.diverged.mean()),
        **{name: float(getattr(measures, name).mean()) for name in means},
        "cost_of_transport": cost_of_all(measures.energy, measures.distance, episodes.weight),
    }


def _tracking(episodes: Episodes, upright: Bools) -> tuple[dict[str, Floats], Floats]:
    """How commands were followed, and the distance covered."""
    settling, intervals = episodes.settling, episodes.intervals
    settled, windows = slice(settling, None), intervals.settled
    command, velocity = (signal.astype(np.float64) for signal in (episodes.command, episodes.heading_velocity))
    after: dict[str, Any] = {"command": command[settled], "velocity": velocity[settled], "upright": upright[settled]}
    measures = {
        "velocity_error": tracking.velocity_error(**after),
        "yaw_rate_error": tracking.yaw_rate_error(**after),
        "velocity_error_upright": tracking.velocity_error_upright(**after),
        "mean_velocity_error": tracking.mean_velocity_error(command, velocity, upright, windows),
        "commands": tracking.commands_given(command, upright, tuple(w.start - settling for w in windows)),
        "mean_velocities": tracking.mean_velocities(velocity, upright, windows),
    }
    return measures, tracking.distance_covered(velocity, upright, intervals.travelled, episodes.dt)
