"""Which cause a failed episode has: the first event that decides, and how certain that is."""

from dataclasses import dataclass, replace

import numpy as np

from evaluate.causes import rules
from evaluate.causes.record import Record
from evaluate.causes.rules import Event, trips
from evaluate.measures import outcomes
from evaluate.measures.averages import Floats, planar
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from quad_env.config import AnyPose, CommandRanges
from quad_env.robots.similarity import ratio
from quad_env.scenarios.scenario import Scenario

DISTURBANCES = "terrain", "pushes", "force", "ground", "motors", "payload", "latency", "noise", "dropouts"
"""Parts of a scenario that make a fall of the controller itself less than certain."""


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
    outcome, failures = measures.outcome[record.number], record.episodes.failure
    if outcome == outcomes.POLICY_ERROR and failures is not None:
        words = f"the policy {' '.join(str(failures[record.number]).split())[:120]}"
        steps = record.episodes.failure_step
        return Verdict(Event(rules.POLICY, 0 if steps is None else int(steps[record.number]), 1.0, words), True)
    return _of_fall(record) if record.fell else _of_upright(record, measures)


def with_causes(measures: Measures, episodes: Episodes) -> Measures:
    """The measures with the causes of the episodes that failed; without, where nothing is known of the scenario."""
    cause, detail = np.full((2, episodes.count), None, dtype=object)
    time = np.full(episodes.count, np.nan)
    for number in np.flatnonzero(measures.outcome != outcomes.SUCCEEDED).tolist() if episodes.scenario else ():
        found = verdict(Record(episodes, episodes.scenario, number), measures)  # type: ignore[arg-type]
        cause[number], detail[number] = found.event.cause, found.detail
        time[number] = found.event.step * episodes.dt
    return replace(measures, cause=cause, cause_time=time, cause_detail=detail)


def _of_fall(record: Record) -> Verdict:
    """Sudden events come first, in the order of time; of what lasts, the strongest, and limits of joints last."""
    if isinstance(record.scenario.start, AnyPose) or record.end <= rules.SWING:
        return Verdict(Event(rules.UNCLEAR, 0, 1.0, "it never came to an ordinary gait"), False)
    events = sorted((event for rule in rules.RULES for event in rule(record)), key=lambda event: event.step)
    seen = tuple(event for event in events if event.strength >= 1.0)
    if not seen:
        return _of_controller(record, max((each.strength for each in events if each.cause != rules.REACH), default=0.0))
    first = min(
        seen, key=lambda each: (not each.sudden, each.cause == rules.REACH, 0.0 if each.sudden else -each.strength)
    )
    rivals = [each for each in seen if each.cause not in (first.cause, rules.REACH) and each.step <= first.step]
    alone = not rivals and first.cause != rules.REACH and not _usual(record, first)
    return Verdict(first, alone and first.strength >= record.at("certain"), seen)


def _usual(record: Record, event: Event) -> bool:
    """Whether its legs were hit as hard before without a fall."""
    before = trips(record, slice(0, record.window.start))
    return event.cause == rules.TRIP and event.step < record.end and any(each.strength >= 1.0 for each in before)


def _of_controller(record: Record, nearest: float) -> Verdict:
    """Without any event that counts: the controller, unless one nearly does or the simulation diverged."""
    if nearest >= record.at("nearly") or record.episodes.diverged[record.number]:
        return Verdict(Event(rules.UNCLEAR, record.onset, 1.0, "no rule decides"), False)
    fastest = CommandRanges().forward[1] * ratio(record.episodes.robot, "m/s")
    undisturbed = all(getattr(record.scenario, name) == getattr(Scenario(""), name) for name in DISTURBANCES)
    certain = nearest < 0.5 and undisturbed and planar(record.of("command")).max() <= fastest
    return Verdict(Event(rules.GAIT, record.onset, 1.0, "it leaves its ordinary gait by itself"), bool(certain))


def _of_upright(record: Record, measures: Measures) -> Verdict:
    """Motors or ground that fail it for long, or what it is shown or sent; else how much of its command it reached."""
    events = [event for rule in rules.UPRIGHT_RULES for event in rule(record)]
    if seen := tuple(event for event in events if event.strength >= 1.0):
        alone = seen[0].cause in (rules.MOTOR, rules.SLIP) and len({event.cause for event in seen} - {rules.REACH}) == 1
        return Verdict(seen[0], alone and seen[0].strength >= record.at("certain"), seen)
    rule, commands = outcomes.RULES[outcomes.SUCCESS_RULE], measures.commands[record.number]
    velocities = measures.mean_velocities[record.number]
    worst = int(np.nanargmax(rule.deviations(commands, velocities) + 10.0 * rule.stalled(commands, velocities)))
    hits = len({event.step // record.steps("look on") for event in trips(record) if event.strength >= 1.0})
    cause, words, certain = _off(record, measures, commands[worst], velocities[worst])
    step = record.episodes.intervals.settled[worst].start
    certain &= all(event.strength < record.at("nearly") for event in events if event.cause != rules.REACH)
    return Verdict(Event(cause, step, 1.0, f"{words}{f'; its legs hit rises {hits} times' if hits else ''}"), certain)


def _off(record: Record, measures: Measures, command: Floats, velocity: Floats) -> tuple[str, str, bool]:
    """Cause, words and certainty by the command and the mean velocity of the worst interval, (3,) each."""
    rule, stalled = outcomes.RULES[outcomes.SUCCESS_RULE], measures.outcome[record.number] == outcomes.STALLED
    speed, turn = float(planar(command)), abs(float(command[2]))
    off = planar(velocity - command) / (rule.linear + rule.share * speed)
    turning = not stalled and abs(velocity[2] - command[2]) / (rule.angular + rule.share * turn) > off
    asked, unit = (turn, "rad/s") if turning else (speed, "m/s")
    along = float(np.sign(command[2]) * velocity[2] if turning else command[:2] @ velocity[:2] / max(speed, 1e-9))
    words = f"{along:.2f} {unit} of the commanded {asked:.2f}"
    if stalled:
        return rules.STALLED, words, True
    if asked > outcomes.MOVING and 0.0 <= along < record.at("slow") * asked:
        return rules.SLOW, f"{along / asked:.0%}: {words}", along < record.at("too slow") * asked
    disturbed = record.scenario.force is not None or record.scenario.pushes is not None
    ahead, left, yaw = velocity
    words = f"not too slow: {ahead:.2f} and {left:.2f} m/s, {yaw:.2f} rad/s for {command.round(2)}"
    return rules.UNCLEAR if disturbed else rules.GAIT, words, False
