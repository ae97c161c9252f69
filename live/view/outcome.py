"""Outcome of an episode in the live view: success or failure with its cause, as in an evaluation.

The outcome is undecided until the robot falls, the policy fails, or the duration of an evaluation episode has passed.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from evaluate.causes.story import in_lines, timeline
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import STEPS, EpisodeRecorder
from live.session import Session


class _RecordedStep(NamedTuple):
    """Record of a control step, and of a failure or safety stop of the policy in this step."""

    step: Step
    failure: Any
    """Text about the failure of the policy for each robot, (1,); None if the policy does not report failures."""
    is_stopped: bool
    """True if the safety layer of the policy has stopped the robot in this step."""


class EpisodeOutcome:
    """Outcome of one episode in the live view.

    The object records the control steps of the episode, and decides the outcome at the end of the episode.

    Args:
        session: Session at the start of an episode.
        max_steps: Duration of an evaluation episode, control steps.

    Attributes:
        story: One line of text per event of the episode; the last line is the outcome. Empty while the outcome is
            undecided.
    """

    def __init__(self, session: Session, max_steps: int = STEPS) -> None:
        self.story: list[str] = []
        self._session = session
        self._max_steps = max_steps
        self._has_ended = False
        self._recorded: deque[_RecordedStep] = deque(maxlen=max_steps + 1)
        self.record()

    def record(self) -> None:
        """Record the latest control step of the session; decide the outcome if this step ends the episode."""
        if self._has_ended:
            return
        step = self._session.latest
        policy = self._session.policy
        failure = getattr(policy, "failure", None)
        is_stopped = bool(np.any(getattr(policy, "stopped", False)))
        self._recorded.append(_RecordedStep(step, failure, is_stopped))
        has_fallen = step.infos["fall"][0] > 0 or step.infos["diverged"][0]
        self._has_ended = bool(has_fallen or (failure is not None and failure[0]))
        if self._has_ended or (step.number == self._max_steps and not self._session.user_intervened):
            self.story = _story(list(self._recorded), self._session, self._max_steps)

    @property
    def words(self) -> str:
        """Outcome of the episode in words; if the outcome is undecided, the reason for this."""
        if self.story:
            return self.story[-1].replace("  ", ": ", 1)
        if self._session.user_intervened:
            return "no outcome: steered, pushed or changed by hand"
        return f"undecided until {self._max_steps * self._session.env.dt:g} s"

    @property
    def failed(self) -> bool:
        """True if the outcome of the episode is decided and is a failure."""
        return bool(self.story) and not self.story[-1].endswith(SUCCEEDED)


def _story(recorded: Sequence[_RecordedStep], session: Session, max_steps: int) -> list[str]:
    """Return the events of an episode as lines of text, each with the time since the start of the episode.

    Args:
        recorded: Latest control steps of the episode; the first of them may be later than the start.
        session: Session of the episode.
        max_steps: Duration of an evaluation episode, control steps.

    Returns:
        Lines of text; the last line is the outcome.
    """
    episodes = _episodes(recorded, session, max_steps)
    start_time = recorded[0].step.number * episodes.dt
    return in_lines((start_time + time, words) for time, words in timeline(episodes, measure(episodes)))


def _episodes(recorded: Sequence[_RecordedStep], session: Session, max_steps: int) -> Episodes:
    """Convert recorded control steps to the record of one episode, as an evaluation uses it.

    The record starts with the first recorded step. The pushes in the record include the pushes that the user requested.

    Args:
        recorded: Latest control steps of the episode.
        session: Session of the episode.
        max_steps: Duration of an evaluation episode, control steps.

    Returns:
        Record with one episode.
    """
    policy: Any = SimpleNamespace()
    recorder = EpisodeRecorder(policy, np.array([session.seed]), max_steps)
    for number, (step, failure, is_stopped) in enumerate(recorded):
        policy.failure = failure
        policy.stopped = np.array([is_stopped])
        recorder(replace(step, number=number))
    # Horizontal force of pushes on the trunk, world frame, (steps, 2), N.
    force = np.array([item.step.infos["push"][0] for item in recorded[1:]]).reshape(-1, 2)
    is_pushed = np.asarray(force.any(axis=1))
    push_starts = np.flatnonzero(is_pushed & ~np.append(False, is_pushed[:-1]))
    episodes = recorder.episodes()
    scenario = session.env.scenario
    if recorded[0].step.number != 0:
        # The times of dropouts are counted from the start of the episode, at which the record does not start.
        scenario = replace(scenario, dropouts=None)
    return replace(
        episodes,
        push_step=push_starts[None],
        push_impulse=np.add.reduceat(force, push_starts)[np.newaxis] * episodes.dt,
        push_steps=int(is_pushed.sum()) // max(1, len(push_starts)),
        scenario=scenario,
    )
