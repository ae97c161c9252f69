"""Timeline of an episode: at most five events, sorted by time, that explain the outcome."""

from collections.abc import Iterable

import numpy as np

from evaluate.causes.record import EpisodeSignals
from evaluate.causes.rules import GAIT, UNCLEAR
from evaluate.causes.verdict import Verdict, verdict
from evaluate.measures.averages import planar
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures
from evaluate.measures.outcomes import SUCCEEDED

MAX_CAUSES = 3
"""Maximum number of events with different causes in a timeline."""


def timeline(episodes: Episodes, measures: Measures, number: int = 0) -> list[tuple[float, str]]:
    """Return the main events of an episode.

    The events are the deciding event, the strongest events of two other causes, and the departure from the ordinary
    gait. The outcome comes last.

    Args:
        episodes: Recorded episodes.
        measures: Measures of the recorded episodes.
        number: Index of the episode.

    Returns:
        Pairs of time (s) and description, such as `front left foot hits the edge of a step (0.15 m) at 0.9 m/s`.
    """
    outcome = str(measures.outcome[number]).replace("_", " ")
    if outcome == SUCCEEDED or episodes.scenario is None:
        return [(episodes.steps * episodes.dt, outcome)]
    record = EpisodeSignals(episodes, episodes.scenario, number)
    decided = verdict(record, measures)
    moments = _events(decided)
    if record.fell and record.end:
        if decided.event.cause in (GAIT, UNCLEAR) and decided.event.step == record.onset:
            moments = []  # dropped, because it says no more than the departure from the gait
        moments.append(_departure(record))
        outcome += f" ({episodes.fall_reason[number].replace('_', ' ')})"
    cause = decided.event.cause.replace("_", " ")
    if decided.event.cause != UNCLEAR:
        cause += f" ({'certain' if decided.certain else 'likely'})"
    moments = [*sorted(moments), (record.end + record.fell, f"{outcome}; cause: {cause}")]
    return [(step * episodes.dt, description) for step, description in moments]


def _events(decided: Verdict) -> list[tuple[int, str]]:
    """Return pairs of step and description: deciding event, then strongest event of each other cause."""
    strongest = {decided.event.cause: decided.event}
    for event in sorted(decided.triggered_events, key=lambda event: -event.score):
        strongest.setdefault(event.cause, event)
    return [(event.step, event.description) for event in list(strongest.values())[:MAX_CAUSES]]


def _departure(record: EpisodeSignals) -> tuple[int, str]:
    """Return the step and a description of the departure from the ordinary gait."""
    step = min(record.onset, record.end - 1)
    tilt = np.degrees(record.signal("tilt")[step])
    offset = planar(record.capture_point_offset)[step]
    description = (
        f"leaves its ordinary gait: tilt {tilt:.0f}°, capture point {offset:.2f} m from the middle of its feet"
    )
    return step, description


def in_lines(moments: Iterable[tuple[float, str]]) -> list[str]:
    """Format each event as a line, such as `2.41 s  front left foot hits the edge of a step (0.15 m)`."""
    return [f"{time:.2f} s  {description}" for time, description in moments]
