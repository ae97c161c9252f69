"""Timeline of an episode for the user: at most five events, sorted by time, that explain the outcome."""

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
"""Maximum number of events in a timeline that have different causes."""


def timeline(episodes: Episodes, measures: Measures, number: int = 0) -> list[tuple[float, str]]:
    """Return the main events of an episode, sorted by time.

    For a failed episode, they are the event that decided the cause, and the strongest events of up to two other causes.
    If the robot fell, the time at which it left its ordinary gait is added. The outcome comes last.

    Args:
        episodes: Recorded episodes.
        measures: Measures of these episodes.
        number: Index of the episode.

    Returns:
        Pairs of time (s) and description, for example `front left foot hits the edge of a step (0.15 m) at 0.9 m/s`.
    """
    outcome = str(measures.outcome[number]).replace("_", " ")
    if outcome == SUCCEEDED or episodes.scenario is None:
        return [(episodes.steps * episodes.dt, outcome)]
    record = EpisodeSignals(episodes, episodes.scenario, number)
    decided = verdict(record, measures)
    moments = _events(decided)
    if record.fell and record.end:
        if decided.event.cause in (GAIT, UNCLEAR) and decided.event.step == record.onset:
            moments = []  # because the departure from the gait, added below, is the same event
        moments.append(_departure(record))
        outcome += f" ({episodes.fall_reason[number].replace('_', ' ')})"
    cause = decided.event.cause.replace("_", " ")
    if decided.event.cause != UNCLEAR:
        cause += f" ({'certain' if decided.certain else 'likely'})"
    moments = [*sorted(moments), (record.end + record.fell, f"{outcome}; cause: {cause}")]
    return [(step * episodes.dt, description) for step, description in moments]


def _events(decided: Verdict) -> list[tuple[int, str]]:
    """Return the control step and the description of the deciding event and of other strong events.

    The others are the events with the highest scores of up to two other causes.
    """
    strongest = {decided.event.cause: decided.event}
    for event in sorted(decided.triggered_events, key=lambda event: -event.score):
        strongest.setdefault(event.cause, event)
    return [(event.step, event.description) for event in list(strongest.values())[:MAX_CAUSES]]


def _departure(record: EpisodeSignals) -> tuple[int, str]:
    """Return the control step and a description of the robot's departure from its ordinary gait."""
    step = min(record.onset, record.end - 1)
    tilt = np.degrees(record.signal("tilt")[step])
    offset = planar(record.capture_point_offset)[step]
    description = (
        f"leaves its ordinary gait: tilt {tilt:.0f}°, capture point {offset:.2f} m from the middle of its feet"
    )
    return step, description


def in_lines(moments: Iterable[tuple[float, str]]) -> list[str]:
    """Format pairs of time and description as lines of text, for example `2.41 s  the trunk meets a rise`."""
    return [f"{time:.2f} s  {description}" for time, description in moments]
