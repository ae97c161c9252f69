"""Timeline of an episode: at most five events, sorted by time, that explain its outcome to the user."""

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
"""Maximum number of possible causes in the timeline of a failed episode; each of them has one event."""


def timeline(episodes: Episodes, measures: Measures, number: int = 0) -> list[tuple[float, str]]:
    """Return the main events of an episode, sorted by time, to explain its outcome to the user.

    The events of a failed episode are the cause of the failure, and the strongest events of up to two other possible
    causes. If the robot fell, the moment at which it left its ordinary gait is added. The last event is the outcome.

    Args:
        episodes: Recorded signals of n episodes.
        measures: Measures of the same n episodes.
        number: Index of the explained episode, 0 … n − 1.

    Returns:
        Pairs of time, s, and description, for example `front left foot hits the edge of a step (0.15 m) at 0.9 m/s`.
    """
    outcome = str(measures.outcome[number]).replace("_", " ")
    if outcome == SUCCEEDED or episodes.scenario is None:
        return [(episodes.steps * episodes.dt, outcome)]
    record = EpisodeSignals(episodes, episodes.scenario, number)
    decided = verdict(record, measures)
    moments = _events(decided)
    if record.fell and record.end:
        if decided.event.cause in (GAIT, UNCLEAR) and decided.event.step == record.onset:
            moments = []  # `_departure`, called below, describes the same event.
        moments.append(_departure(record))
        outcome += f" ({episodes.fall_reason[number].replace('_', ' ')})"
    cause = decided.event.cause.replace("_", " ")
    if decided.event.cause != UNCLEAR:
        cause += f" ({'certain' if decided.certain else 'likely'})"
    moments = [*sorted(moments), (record.end + record.fell, f"{outcome}; cause: {cause}")]
    return [(step * episodes.dt, description) for step, description in moments]


def _events(decided: Verdict) -> list[tuple[int, str]]:
    """Return control step and description of the cause of a failure, and of up to two other events.

    The other events belong to other possible causes: for each possible cause, the event with the highest score is
    chosen.

    Args:
        decided: Verdict on the failed episode.

    Returns:
        Pairs of control step and description, the cause of the failure first.
    """
    strongest = {decided.event.cause: decided.event}
    for event in sorted(decided.triggered_events, key=lambda event: -event.score):
        strongest.setdefault(event.cause, event)
    return [(event.step, event.description) for event in list(strongest.values())[:MAX_CAUSES]]


def _departure(record: EpisodeSignals) -> tuple[int, str]:
    """Return control step and description of the moment at which the robot left its ordinary gait.

    The description contains the tilt of the trunk in this control step. It also contains the distance of the capture
    point, at which the robot would have to step to come to rest, from the middle of the feet.
    """
    step = min(record.onset, record.end - 1)
    tilt = np.degrees(record.signal("tilt")[step])
    offset = planar(record.capture_point_offset)[step]
    description = (
        f"leaves its ordinary gait: tilt {tilt:.0f}°, capture point {offset:.2f} m from the middle of its feet"
    )
    return step, description


def in_lines(moments: Iterable[tuple[float, str]]) -> list[str]:
    """Format the events `moments`, pairs of time (s) and description, as one line of text for each event.

    An example of a line is `2.41 s  the trunk meets a rise (0.08 m)`.
    """
    return [f"{time:.2f} s  {description}" for time, description in moments]
