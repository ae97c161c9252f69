"""Which cause a failed episode has: the first event that decides, and how certain that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from evaluate.causes import rules
from evaluate.causes.record import Record
from evaluate.causes.rules import GAIT, MOTOR, POLICY, REACH, SLIP, SLOW, STALLED, UNCLEAR, Event
from evaluate.causes.thresholds import at
from evaluate.measures.averages import planar
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from evaluate.measures.outcomes import POLICY_ERROR, RULES, SUCCEEDED, SUCCESS_RULE
from quad_env.config import AnyPose, CommandRanges
from quad_env.robots.similarity import ratio


@dataclass(frozen=True)
class Verdict:
    """Why an episode failed."""

    event: Event
    """What it began with."""
    certain: bool
    seen: tuple[Event, ...] = ()
    """All that counted, in the order of time."""

    @property
    def detail(self) -> str:
        """What decided, and how certain it is."""
        return f"{self.event.words} ({'certain' if self.certain else 'likely'})"


def verdict(record: Record, measures: Measures) -> Verdict:
    """Why that episode failed."""
    outcome = measures.outcome[record.number]
    if outcome == POLICY_ERROR:
        return Verdict(_policy_error(record), True)
    return _of_fall(record) if record.fell else _of_upright(record, measures, str(outcome))


def with_causes(measures: Measures, episodes: Episodes) -> Measures:
    """The measures with the causes of the episodes that failed; without, where nothing is known of the scenario."""
    cause, detail = np.full((2, episodes.count), None, dtype=object)
    time = np.full(episodes.count, np.nan)
    if episodes.scenario is not None:
        for number in np.flatnonzero(measures.outcome != SUCCEEDED).tolist():
            found = verdict(Record(episodes, episodes.scenario, number), measures)
            cause[number], detail[number] = found.event.cause, found.detail
            time[number] = found.event.step * episodes.dt
    return replace(measures, cause=cause, cause_time=time, cause_detail=detail)


def _policy_error(record: Record) -> Event:
    failures, steps = record.episodes.failure, record.episodes.failure_step
    words = " ".join(str(failures[record.number] if failures is not None else "failed").split())[:120]
    return Event(POLICY, 0 if steps is None else int(steps[record.number]), 1.0, f"the policy {words}")


def _of_fall(record: Record) -> Verdict:
    """Sudden events come first, in the order of time; of what lasts, the strongest."""
    if isinstance(record.scenario.start, AnyPose) or record.onset < record.steps("start") // 2:
        return _from_the_start(record)
    events = [event for rule in rules.RULES for event in rule(record)]
    seen = tuple(sorted((event for event in events if event.strength >= 1.0), key=lambda event: event.step))
    sudden = [event for event in seen if event.sudden]
    lasting = sorted((event for event in seen if not event.sudden), key=lambda event: (event.cause == REACH, -event.strength))
    if not seen:
        return _of_controller(record, events)
    first = (sudden or lasting)[0]
    rivals = [each for each in seen if each.cause not in (first.cause, REACH) and each.step <= first.step]
    return Verdict(first, first.strength >= at("certain") and not rivals, seen)


def _from_the_start(record: Record) -> Verdict:
    """Of a robot that never came to an ordinary gait: its controller where nothing disturbs it, else unclear."""
    events = [event for rule in rules.RULES for event in rule(record) if event.strength >= 0.5]
    if events or isinstance(record.scenario.start, AnyPose):
        return Verdict(Event(UNCLEAR, 0, 1.0, "it never came to an ordinary gait"), False, tuple(events))
    return Verdict(Event(GAIT, 0, 1.0, "undisturbed, it never came to an ordinary gait"), True)


def _of_controller(record: Record, events: Sequence[Event]) -> Verdict:
    """Without any event that counts: the controller, unless one nearly does or the simulation diverged."""
    nearest = max(events, key=lambda event: event.strength, default=None)
    if record.episodes.diverged[record.number]:
        return Verdict(Event(UNCLEAR, record.end, 1.0, "the simulation diverged"), False)
    if nearest is not None and nearest.strength >= 0.75:
        return Verdict(Event(UNCLEAR, record.onset, 1.0, f"nothing decides; perhaps: {nearest.words}"), False)
    tilt = record.of("tilt")[min(record.onset, record.end - 1)]
    fastest = planar(record.of("command")).max() <= CommandRanges().forward[1] * ratio(record.episodes.robot, "m/s")
    certain = (nearest is None or nearest.strength < 0.5) and bool(fastest)
    return Verdict(Event(GAIT, record.onset, 1.0, f"it leaves its ordinary gait by itself, tilt {tilt:.2f} rad"), certain)


def _of_upright(record: Record, measures: Measures, outcome: str) -> Verdict:
    """Motors and ground that fail it for long; else how much of its command it reached."""
    lasting = [event for rule in (rules.motors, rules.slides, rules.limits) for event in rule(record)]
    counting = [event for event in lasting if event.strength >= 1.0]
    order = (MOTOR, SLIP, REACH)
    if counting:
        first = min(counting, key=lambda event: order.index(event.cause))
        alone = len({event.cause for event in counting if event.cause != REACH} | {first.cause}) == 1
        return Verdict(first, alone and first.strength >= at("certain"), tuple(counting))
    hits = len({event.step // record.steps("look on") for event in rules.trips(record) if event.strength >= 1.0})
    commands, velocities = measures.commands[record.number], measures.mean_velocities[record.number]
    rule = RULES[SUCCESS_RULE]
    worst = int(np.nanargmax(rule.deviations(commands, velocities) + 10.0 * rule.stalled(commands, velocities)))
    command, velocity = commands[worst], velocities[worst]
    step = record.episodes.intervals.settled[worst].start
    return _slow(command, velocity, step, outcome == "stalled", f"; its legs hit rises {hits} times" if hits else "")


def _slow(command: np.ndarray, velocity: np.ndarray, step: int, stalled: bool, also: str) -> Verdict:
    """Of an interval's command and mean velocity, (3,) each."""
    rule, speed = RULES[SUCCESS_RULE], float(planar(command))
    off = planar(velocity - command) / (rule.linear + rule.share * speed)
    turning = abs(velocity[2] - command[2]) / (rule.angular + rule.share * abs(command[2])) > off and not stalled
    asked, unit = (abs(float(command[2])), "rad/s") if turning else (speed, "m/s")
    along = float(np.sign(command[2]) * velocity[2] if turning else command[:2] @ velocity[:2] / max(speed, 1e-9))
    words = f"{along:.2f} {unit} of the commanded {asked:.2f}{also}"
    if stalled:
        return Verdict(Event(STALLED, step, 1.0, words), True)
    if asked > 0.05 and -0.1 * asked <= along < 0.9 * asked:
        return Verdict(Event(SLOW, step, 1.0, f"{along / asked:.0%}: {words}"), along < 0.8 * asked)
    return Verdict(Event(GAIT, step, 1.0, f"off its command, not too slow: {words}"), False)
