"""The story of an episode in at most five moments, in the order of time, from the events that decide its cause."""

from collections.abc import Iterable

import numpy as np

from evaluate.causes.record import EpisodeSignals
from evaluate.causes.rules import GAIT, UNCLEAR
from evaluate.causes.verdict import verdict
from evaluate.measures.averages import planar
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from evaluate.measures.outcomes import SUCCEEDED


def timeline(episodes: Episodes, measures: Measures, number: int = 0) -> list[tuple[float, str]]:
    """Times, s, and words, such as `front left foot hits the edge of a step (0.15 m) at 0.9 m/s`, the outcome last: the
    event that decided, the strongest of two other causes, and when the robot left its gait."""
    ended = str(measures.outcome[number]).replace("_", " ")
    if ended == SUCCEEDED or episodes.scenario is None:
        return [(episodes.steps * episodes.dt, ended)]
    record = EpisodeSignals(episodes, episodes.scenario, number)
    found = verdict(record, measures)
    shown = {found.event.cause: found.event}
    for event in sorted(found.triggered_events, key=lambda event: -event.score):
        shown.setdefault(event.cause, event)
    moments = [(event.step, event.description) for event in list(shown.values())[:3]]
    if record.fell and record.end:
        if found.event.cause in (GAIT, UNCLEAR) and found.event.step == record.onset:
            moments = []  # nothing more is known than what follows
        step = min(record.onset, record.end - 1)
        tilt, away = np.degrees(record.of("tilt")[step]), planar(record.capture_point_offset)[step]
        words = f"leaves its ordinary gait: tilt {tilt:.0f}°, capture point {away:.2f} m from the middle of its feet"
        moments.append((step, words))
        ended += f" ({episodes.fall_reason[number].replace('_', ' ')})"
    cause = found.event.cause.replace("_", " ")
    if found.event.cause != UNCLEAR:
        cause += f" ({'certain' if found.certain else 'likely'})"
    moments = [*sorted(moments), (record.end + record.fell, f"{ended}; cause: {cause}")]
    return [(step * episodes.dt, words) for step, words in moments]


def in_lines(moments: Iterable[tuple[float, str]]) -> list[str]:
    """`2.41 s  front left foot hits the edge of a step (0.15 m) at 0.9 m/s` for each moment."""
    return [f"{time:.2f} s  {words}" for time, words in moments]
