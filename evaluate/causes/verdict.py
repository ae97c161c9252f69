"""Choice of the cause of a failed episode among the events that the rules find, and its certainty."""

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
"""Minimum score (measured quantity / threshold) of an event that can be the cause of a failure."""
MAX_FAILURE_LENGTH = 120
"""Number of characters after which a policy's error message is cut in the description of a cause."""


class Verdict(NamedTuple):
    """Cause of a failed episode: the event that caused the failure, and the certainty of this choice."""

    event: Event
    """Event that caused the failure, for example a collision of a foot with a step."""
    certain: bool
    """True if the event certainly caused the failure; False if it is only the likely cause."""
    triggered_events: tuple[Event, ...] = ()
    """All events of the episode with a score (quantity / threshold) of at least 1.

    The events are sorted by time if the robot fell, and otherwise by the priority of the rules that found them.
    """

    @property
    def detail(self) -> str:
        """Description of the event that caused the failure, followed by `(certain)` or `(likely)`."""
        return f"{self.event.description} ({'certain' if self.certain else 'likely'})"


def with_causes(measures: Measures, episodes: Episodes) -> Measures:
    """Add the cause of each failed episode, its time and its description to the measures of n episodes.

    Args:
        measures: Measures of n episodes, with the outcome but without the causes of failure.
        episodes: Recorded signals of the same n episodes.

    Returns:
        A copy of the measures with causes; `measures` itself if the scenario of the episodes is not known.
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

    The cause is `policy_error` if the policy failed. Otherwise rules search for the cause in the recorded signals.

    Args:
        record: Signals of the failed episode.
        measures: Measures of all n episodes in `record.episodes`, with the outcome of each episode.

    Returns:
        The event that caused the failure, and the certainty of this choice.
    """
    number = record.number
    if measures.outcome[number] == outcomes.POLICY_ERROR:
        failure = " ".join(str(record.episodes.failure[number]).split())[:MAX_FAILURE_LENGTH]
        step = int(record.episodes.failure_step[number])
        return Verdict(Event(rules.POLICY, step, 1.0, f"the policy {failure}"), True)
    return _verdict_on_fall(record) if record.fell else _verdict_on_upright(record, measures)


def _verdict_on_fall(record: EpisodeSignals) -> Verdict:
    """Choose the cause of a fall: the first instantaneous event, otherwise the strongest lasting event.

    Only events with a score (quantity / threshold) of at least 1 count. A joint limit is chosen only if no other event
    has a score of at least 1. The cause is `unclear` if the scenario starts in a random pose, or if the robot falls
    within the first control steps.

    Args:
        record: Signals of the episode in which the robot fell.

    Returns:
        The event that caused the fall, and the certainty of this choice.
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
    """Return True if the event `first` certainly caused a fall.

    The score of this event must be high, and no event with another cause may begin earlier or at the same time. If the
    event is a trip, the robot must not have tripped earlier in the episode and stayed upright. A joint limit is never a
    certain cause, and it does not count as another cause.

    Args:
        record: Signals of the episode in which the robot fell.
        first: Event that was chosen as the cause of the fall.
        triggered_events: All events with a score (quantity / threshold) of at least 1.

    Returns:
        True if the event certainly caused the fall.
    """
    has_competing_cause = any(
        event.step <= first.step for event in triggered_events if event.cause not in (first.cause, rules.REACH)
    )
    is_usual = False
    if (
        first.cause == rules.TRIP and first.step < record.end
    ):  # An earlier trip that did not make the robot fall shows that this trip need not be the cause.
        is_usual = any(event.score >= TRIGGERED for event in trips(record, slice(0, record.window.start)))
    is_strong = first.score >= record.threshold("certain") and first.cause != rules.REACH
    return is_strong and not has_competing_cause and not is_usual


def _verdict_without_event(record: EpisodeSignals, max_score: float) -> Verdict:
    """Choose the cause of a fall if no event has a score (quantity / threshold) of at least 1.

    The cause is then `gait`: the gait of the robot itself leads to the fall. The cause is `unclear` if the score of an
    event is nearly 1, or if the simulation diverged.

    Args:
        record: Signals of the episode in which the robot fell.
        max_score: Largest score of the events other than joint limits, below 1.

    Returns:
        The cause of the fall. It can be certain only if the scenario has no disturbance.
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
    """Choose the cause of a failed episode in which the robot stayed upright.

    The cause is the first event that UPRIGHT_RULES find with a score (quantity / threshold) of at least 1. If no event
    has this score, the cause follows from the deviation of the robot's velocity from the command.

    Args:
        record: Signals of the failed episode.
        measures: Measures of all n episodes in `record.episodes`.

    Returns:
        The event that caused the failure, and the certainty of this choice.
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
    """Return the index of the interval of constant command with the worst velocity error.

    The velocity error is divided by the tolerance of the success rule. An interval in which the robot covered too
    little of the commanded distance counts as worse: 10 is added to the quotient of error and tolerance.

    Args:
        measures: Measures of n episodes.
        number: Index of the episode, 0 … n − 1.

    Returns:
        Index of the command interval within the episode.
    """
    rule = outcomes.RULES[outcomes.SUCCESS_RULE]
    commands = measures.commands[number]
    velocities = measures.mean_velocities[number]
    return int(np.nanargmax(rule.deviations(commands, velocities) + 10.0 * rule.stalled(commands, velocities)))


def _off_command(record: EpisodeSignals, measures: Measures, interval: int) -> tuple[str, str, bool]:
    """Determine the cause of a deviation from the velocity command if no event explains the deviation.

    Args:
        record: Signals of the failed episode, in which the robot stayed upright.
        measures: Measures of all n episodes in `record.episodes`.
        interval: Index of the command interval (interval of constant command) with the largest deviation.

    Returns:
        cause: Name of the cause: `stalled`, `too_slow`, `gait` or `unclear`.
        description: Text with the commanded and the achieved velocity, m/s or rad/s.
        certain: True if the velocities alone make this cause certain.
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
    """Format a `velocity`, (3,), as text: forward and left, m/s, and yaw rate, rad/s, heading frame."""
    return f"{velocity[0]:.2f} m/s forward, {velocity[1]:.2f} m/s left, {velocity[2]:.2f} rad/s"
