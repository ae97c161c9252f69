"""Verdict on a failed episode: the event that caused the failure, and whether this is certain."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from evaluate.causes import rules
from evaluate.causes.record import EpisodeSignals
from evaluate.causes.rules import Event, trips
from evaluate.measures import outcomes
from evaluate.measures.averages import planar
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from quad_env.config import AnyPose, CommandRanges
from quad_env.robots.similarity import scale_factor
from quad_env.scenarios.scenario import Scenario

TRIGGERED = 1.0
"""Minimum score of an event that can be the cause of a failure."""
MAX_FAILURE_LENGTH = 120
"""Maximum length of a policy's error message in the description of a cause, characters."""


class Verdict(NamedTuple):
    """Cause of a failed episode.

    It has the deciding event, a flag that is true if the cause is certain, and all events with a score of at least 1.
    """

    event: Event
    certain: bool
    triggered_events: tuple[Event, ...] = ()

    @property
    def detail(self) -> str:
        """Description of the deciding event, followed by `(certain)` or `(likely)`."""
        return f"{self.event.description} ({'certain' if self.certain else 'likely'})"


def with_causes(measures: Measures, episodes: Episodes) -> Measures:
    """Add the causes of failure to the `measures` of `episodes`.

    Args:
        measures: Measures without causes of failure.
        episodes: Recorded episodes of the measures.

    Returns:
        Measures with causes; unchanged if the scenario of the episodes is not known.
    """
    if episodes.scenario is None:
        return measures
    cause = np.full(episodes.count, None, dtype=object)
    detail = np.full(episodes.count, None, dtype=object)
    time = np.full(episodes.count, np.nan)
    for number in np.flatnonzero(~measures.succeeded).tolist():
        decided = verdict(EpisodeSignals(episodes, episodes.scenario, number), measures)
        cause[number] = decided.event.cause
        detail[number] = decided.detail
        time[number] = decided.event.step * episodes.dt
    return replace(measures, cause=cause, cause_time=time, cause_detail=detail)


def verdict(record: EpisodeSignals, measures: Measures) -> Verdict:
    """Determine the cause of a failed episode.

    Args:
        record: Signals of the failed episode.
        measures: Measures of all episodes in `record.episodes`, with outcomes.

    Returns:
        The cause of the failure: an error of the policy, or a cause that the rules find.
    """
    number = record.number
    if measures.outcome[number] == outcomes.POLICY_ERROR:
        failure = " ".join(str(record.episodes.failure[number]).split())[:MAX_FAILURE_LENGTH]
        step = int(record.episodes.failure_step[number])
        return Verdict(Event(rules.POLICY, step, 1.0, f"the policy {failure}"), True)
    return _verdict_on_fall(record) if record.fell else _verdict_on_upright(record, measures)


def _verdict_on_fall(record: EpisodeSignals) -> Verdict:
    """Choose the cause of a fall: the first instantaneous event, otherwise the strongest lasting event.

    Only events with a score of at least 1 count. A joint limit is chosen only if there is no other event. The cause is
    unclear if the scenario starts in a random pose, or if the robot falls within its first control steps.
    """
    if isinstance(record.scenario.start, AnyPose) or record.end <= rules.TRIP_WINDOW_STEPS:
        return Verdict(Event(rules.UNCLEAR, 0, 1.0, "it never came to an ordinary gait"), False)
    events = sorted((event for rule in rules.RULES for event in rule(record)), key=lambda event: event.step)
    triggered_events = tuple(event for event in events if event.score >= TRIGGERED)
    if not triggered_events:
        max_score = max((event.score for event in events if event.cause != rules.REACH), default=0.0)
        return _verdict_without_event(record, max_score)
    instantaneous = [event for event in triggered_events if event.is_instantaneous]
    if instantaneous:
        first = instantaneous[0]
    else:
        first = max(triggered_events, key=lambda event: (event.cause != rules.REACH, event.score))
    return Verdict(first, _is_certain(record, first, triggered_events), triggered_events)


def _is_certain(record: EpisodeSignals, first: Event, triggered_events: tuple[Event, ...]) -> bool:
    """Return True if an event is certainly the cause of a fall.

    The score of the event must be high, and no event of another cause may begin earlier or at the same time. If the
    event is a trip, the robot must not have survived an equally strong trip before. Joint limits are never certain, and
    do not count as another cause.

    Args:
        record: Signals of the episode.
        first: Event that was chosen as the cause.
        triggered_events: All events with a score of at least 1.

    Returns:
        True if the cause is certain.
    """
    has_competing_cause = any(
        event.step <= first.step for event in triggered_events if event.cause not in (first.cause, rules.REACH)
    )
    is_usual = False
    if (
        first.cause == rules.TRIP and first.step < record.end
    ):  # because the legs may have been hit as hard before, but the robot did not fall
        is_usual = any(event.score >= TRIGGERED for event in trips(record, slice(0, record.window.start)))
    is_strong = first.score >= record.threshold("certain") and first.cause != rules.REACH
    return is_strong and not has_competing_cause and not is_usual


def _verdict_without_event(record: EpisodeSignals, max_score: float) -> Verdict:
    """Choose the cause of a fall if no event has a score of at least 1: the gait itself, or unclear.

    The cause is unclear if the score of an event was nearly 1, or if the simulation diverged.

    Args:
        record: Signals of the episode.
        max_score: Largest score of all events, below TRIGGERED.

    Returns:
        The cause. It can be certain only if the scenario has no disturbance.
    """
    if max_score >= record.threshold("nearly") or record.episodes.diverged[record.number]:
        return Verdict(Event(rules.UNCLEAR, record.onset, 1.0, "no rule decides"), False)
    max_speed = CommandRanges().forward[1] * scale_factor(record.episodes.robot, "m/s")
    ordinary_fields = ("name", "commands", "start", "axis", "severity", "severity_unit")
    ordinary = Scenario(**{name: getattr(record.scenario, name) for name in ordinary_fields})
    is_undisturbed = record.scenario == ordinary and planar(record.signal("command")).max() <= max_speed
    certain = is_undisturbed and max_score < record.threshold("far")
    return Verdict(Event(rules.GAIT, record.onset, 1.0, "it leaves its ordinary gait by itself"), bool(certain))


def _verdict_on_upright(record: EpisodeSignals, measures: Measures) -> Verdict:
    """Choose the cause of a failure in which the robot stayed upright.

    It is the first event by UPRIGHT_RULES with a score of at least 1. If there is none, the cause is the deviation from
    the velocity command.

    Args:
        record: Signals of the episode.
        measures: Measures of all episodes in `record.episodes`.

    Returns:
        The cause of the failure.
    """
    events = [event for rule in rules.UPRIGHT_RULES for event in rule(record)]
    if triggered_events := tuple(event for event in events if event.score >= TRIGGERED):
        first = triggered_events[0]
        is_only_cause = (
            first.cause in (rules.MOTOR, rules.SLIP)
            and len({event.cause for event in triggered_events} - {rules.REACH}) == 1
        )
        return Verdict(first, is_only_cause and first.score >= record.threshold("certain"), triggered_events)
    worst = worst_interval(measures, record.number)
    cause, description, certain = _off_command(record, measures, worst)
    hits = len({event.step // record.steps("look on") for event in trips(record) if event.score >= TRIGGERED})
    if hits:
        description += f"; its legs hit rises {hits} times"
    certain &= all(event.score < record.threshold("far") for event in events if event.cause != rules.REACH)
    return Verdict(Event(cause, record.episodes.intervals.settled[worst].start, 1.0, description), certain)


def worst_interval(measures: Measures, number: int) -> int:
    """Return the index of the interval of constant command with the largest velocity error.

    The error is relative to the tolerance of the success rule. Intervals in which the robot hardly moved although a
    velocity was commanded come first.

    Args:
        measures: Measures of n episodes.
        number: Index of the episode.

    Returns:
        Index of the command interval.
    """
    rule = outcomes.RULES[outcomes.SUCCESS_RULE]
    commands = measures.commands[number]
    velocities = measures.mean_velocities[number]
    return int(np.nanargmax(rule.deviations(commands, velocities) + 10.0 * rule.stalled(commands, velocities)))


def _off_command(record: EpisodeSignals, measures: Measures, interval: int) -> tuple[str, str, bool]:
    """Determine the cause of a deviation from the velocity command that no event explains.

    Args:
        record: Signals of the episode.
        measures: Measures of all episodes in `record.episodes`.
        interval: Index of the command interval with the largest deviation.

    Returns:
        cause: Name of the cause: stalled, too slow, gait or unclear.
        description: Text with the commanded and the achieved velocity.
        certain: True if the cause is certain, as far as this deviation shows.
    """
    command = measures.commands[record.number, interval]
    velocity = measures.mean_velocities[record.number, interval]
    rule = outcomes.RULES[outcomes.SUCCESS_RULE]
    planar_axes = np.array([1.0, 1.0, 0.0])
    is_stalled = measures.outcome[record.number] == outcomes.STALLED
    planar_deviation = rule.deviations(planar_axes * command, planar_axes * velocity)
    if not is_stalled and planar_deviation < rule.deviations(command, velocity):
        commanded = abs(command[2])
        achieved = float((1.0 - planar_axes) * command @ velocity / max(commanded, 1e-9))
        description = f"turns at {achieved:.2f} of the commanded {commanded:.2f} rad/s"
    else:
        commanded = planar(command)
        achieved = float(planar_axes * command @ velocity / max(commanded, 1e-9))
        description = f"moves at {achieved:.2f} of the commanded {commanded:.2f} m/s"
    is_disturbed = record.scenario.force is not None or record.scenario.pushes is not None
    if is_stalled:
        return rules.STALLED, description, not is_disturbed
    if commanded > outcomes.MOVING and 0.0 <= achieved < record.threshold("slow") * commanded:
        return rules.SLOW, description, bool(achieved < record.threshold("too slow") * commanded)
    cause = rules.UNCLEAR if is_disturbed else rules.GAIT
    return cause, f"moves at {_velocity_text(velocity)}; commanded {_velocity_text(command)}", False


def _velocity_text(velocity: np.ndarray) -> str:
    """Format a velocity (forward, m/s, left, m/s, yaw rate, rad/s), (3,), as text."""
    return f"{velocity[0]:.2f} m/s forward, {velocity[1]:.2f} m/s left, {velocity[2]:.2f} rad/s"
