"""Which cause a failed episode has: the first event that decides, and how certain that is."""

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


class Verdict(NamedTuple):
    """Why an episode failed: the event that it began with, whether that is certain, and all events that counted, in
    the order of time."""

    event: Event
    certain: bool
    triggered_events: tuple[Event, ...] = ()

    @property
    def detail(self) -> str:
        """What decided, and how certain it is."""
        return f"{self.event.description} ({'certain' if self.certain else 'likely'})"


def with_causes(measures: Measures, episodes: Episodes) -> Measures:
    """The measures with the causes of the episodes that failed; as they are, where nothing is known of the scenario."""
    if episodes.scenario is None:
        return measures
    cause, detail = np.full((2, episodes.count), None, dtype=object)
    time = np.full(episodes.count, np.nan)
    for number in np.flatnonzero(~measures.succeeded).tolist():
        found = verdict(EpisodeSignals(episodes, episodes.scenario, number), measures)
        cause[number], detail[number], time[number] = found.event.cause, found.detail, found.event.step * episodes.dt
    return replace(measures, cause=cause, cause_time=time, cause_detail=detail)


def verdict(record: EpisodeSignals, measures: Measures) -> Verdict:
    """Why that episode failed."""
    if measures.outcome[record.number] != outcomes.POLICY_ERROR:
        return _of_fall(record) if record.fell else _of_upright(record, measures)
    failure, step = (of[record.number] for of in (record.episodes.failure, record.episodes.failure_step))
    return Verdict(Event(rules.POLICY, int(step), 1.0, f"the policy {' '.join(str(failure).split())[:120]}"), True)


def _of_fall(record: EpisodeSignals) -> Verdict:
    """Sudden events come first, in the order of time; of what lasts, the strongest, and limits of joints last."""
    if isinstance(record.scenario.start, AnyPose) or record.end <= rules.TRIP_WINDOW_STEPS:
        return Verdict(Event(rules.UNCLEAR, 0, 1.0, "it never came to an ordinary gait"), False)
    events = sorted((event for rule in rules.RULES for event in rule(record)), key=lambda event: event.step)
    triggered_events = tuple(event for event in events if event.score >= 1.0)
    if not triggered_events:
        return _of_controller(record, max((each.score for each in events if each.cause != rules.REACH), default=0.0))
    sudden = [event for event in triggered_events if event.is_instantaneous]
    first = sudden[0] if sudden else max(triggered_events, key=lambda each: (each.cause != rules.REACH, each.score))
    has_competing_cause = any(
        each.step <= first.step for each in triggered_events if each.cause not in (first.cause, rules.REACH)
    )
    # its legs may have been hit as hard before without a fall
    usual = first.cause == rules.TRIP and first.step < record.end
    usual = usual and any(each.score >= 1.0 for each in trips(record, slice(0, record.window.start)))
    certain = (
        first.score >= record.threshold("certain")
        and first.cause != rules.REACH
        and not has_competing_cause
        and not usual
    )
    return Verdict(first, certain, triggered_events)


def _of_controller(record: EpisodeSignals, max_score: float) -> Verdict:
    """Without any event that counts: the controller, unless one nearly does or the simulation diverged."""
    if max_score >= record.threshold("nearly") or record.episodes.diverged[record.number]:
        return Verdict(Event(rules.UNCLEAR, record.onset, 1.0, "no rule decides"), False)
    fastest = CommandRanges().forward[1] * scale_factor(record.episodes.robot, "m/s")
    kept = "name", "commands", "start", "axis", "severity", "severity_unit"
    ordinary = Scenario(**{name: getattr(record.scenario, name) for name in kept})
    undisturbed = record.scenario == ordinary and planar(record.of("command")).max() <= fastest
    certain = undisturbed and max_score < record.threshold("far")
    return Verdict(Event(rules.GAIT, record.onset, 1.0, "it leaves its ordinary gait by itself"), bool(certain))


def _of_upright(record: EpisodeSignals, measures: Measures) -> Verdict:
    """Motors or ground that fail it for long, or what it is shown or sent; else how much of its command it reached."""
    events = [event for rule in rules.UPRIGHT_RULES for event in rule(record)]
    if triggered_events := tuple(event for event in events if event.score >= 1.0):
        alone = (
            triggered_events[0].cause in (rules.MOTOR, rules.SLIP)
            and len({event.cause for event in triggered_events} - {rules.REACH}) == 1
        )
        return Verdict(
            triggered_events[0], alone and triggered_events[0].score >= record.threshold("certain"), triggered_events
        )
    worst = worst_interval(measures, record.number)
    cause, words, certain = _off_command(record, measures, worst)
    if hits := len({event.step // record.steps("look on") for event in trips(record) if event.score >= 1.0}):
        words += f"; its legs hit rises {hits} times"
    certain &= all(event.score < record.threshold("far") for event in events if event.cause != rules.REACH)
    return Verdict(Event(cause, record.episodes.intervals.settled[worst].start, 1.0, words), certain)


def worst_interval(measures: Measures, number: int) -> int:
    """The command interval in which that episode is farthest off its command; one that is stalled before any other."""
    rule = outcomes.RULES[outcomes.SUCCESS_RULE]
    commands, velocities = measures.commands[number], measures.mean_velocities[number]
    return int(np.nanargmax(rule.deviations(commands, velocities) + 10.0 * rule.stalled(commands, velocities)))


def _off_command(record: EpisodeSignals, measures: Measures, interval: int) -> tuple[str, str, bool]:
    """Cause, words and certainty by what was reached of the command in that interval."""
    command, velocity = measures.commands[record.number, interval], measures.mean_velocities[record.number, interval]
    rule, flat = outcomes.RULES[outcomes.SUCCESS_RULE], np.array([1.0, 1.0, 0.0])
    stalled = measures.outcome[record.number] == outcomes.STALLED
    turning = not stalled and rule.deviations(flat * command, flat * velocity) < rule.deviations(command, velocity)
    asked, verb, unit = (abs(command[2]), "turns", "rad/s") if turning else (planar(command), "moves", "m/s")
    along = float((1.0 - flat if turning else flat) * command @ velocity / max(asked, 1e-9))
    words = f"{verb} at {along:.2f} of the commanded {asked:.2f} {unit}"
    disturbed = record.scenario.force is not None or record.scenario.pushes is not None
    if stalled:
        return rules.STALLED, words, not disturbed
    if asked > outcomes.MOVING and 0.0 <= along < record.threshold("slow") * asked:
        return rules.SLOW, words, bool(along < record.threshold("too slow") * asked)
    actual, asked_for = (f"{v[0]:.2f} m/s forward, {v[1]:.2f} m/s left, {v[2]:.2f} rad/s" for v in (velocity, command))
    return rules.UNCLEAR if disturbed else rules.GAIT, f"moves at {actual}; commanded {asked_for}", False
