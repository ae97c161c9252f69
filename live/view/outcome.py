"""Outcome of the shown episode, with its story and cause, by the rules of an evaluation.

It is undecided until the robot falls or the time of an episode is over.
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
    """A control step and the state of the policy after it."""

    step: Step
    failure: Any
    """Failure of the policy per robot, or None."""
    is_stopped: bool
    """True if the safety layer was stopping the robot."""


class EpisodeOutcome:
    """Records the latest control steps of a session's episode, from its start, and judges the episode.

    Args:
        session: The session, at the start of an episode.

    Attributes:
        story: Events of the episode, with the outcome and its cause last; empty while undecided.
    """

    def __init__(self, session: Session) -> None:
        self.story: list[str] = []
        self._session = session
        self._has_ended = False
        self._recorded: deque[_RecordedStep] = deque(maxlen=STEPS + 1)
        self.record()

    def record(self) -> None:
        """Record the last control step."""
        if self._has_ended:
            return
        step = self._session.latest
        policy = self._session.policy
        failure = getattr(policy, "failure", None)
        is_stopped = bool(np.any(getattr(policy, "stopped", False)))
        self._recorded.append(_RecordedStep(step, failure, is_stopped))
        has_fallen = step.infos["fall"][0] > 0 or step.infos["diverged"][0]
        self._has_ended = bool(has_fallen or (failure is not None and failure[0]))
        if self._has_ended or (step.number == STEPS and not self._session.user_intervened):
            self.story = _story(list(self._recorded), self._session)

    @property
    def words(self) -> str:
        """Outcome in words, as far as it is known."""
        if self.story:
            return self.story[-1].replace("  ", ": ", 1)
        if self._session.user_intervened:
            return "no outcome: steered, pushed or changed by hand"
        return f"undecided until {STEPS * self._session.env.dt:g} s"

    @property
    def failed(self) -> bool:
        """True if the outcome is decided and no success."""
        return bool(self.story) and not self.story[-1].endswith(SUCCEEDED)


def _story(recorded: Sequence[_RecordedStep], session: Session) -> list[str]:
    """Return the lines of `evaluate.causes.story` for the recorded steps, with the times of the episode."""
    episodes = _episodes(recorded, session)
    start_time = recorded[0].step.number * episodes.dt
    return in_lines((start_time + time, words) for time, words in timeline(episodes, measure(episodes)))


def _episodes(recorded: Sequence[_RecordedStep], session: Session) -> Episodes:
    """Return the recorded steps as an episode that starts with the first, with the pushes by hand."""
    policy: Any = SimpleNamespace()
    recorder = EpisodeRecorder(policy, np.array([session.seed]), STEPS)
    for number, (step, failure, is_stopped) in enumerate(recorded):
        policy.failure = failure
        policy.stopped = np.array([is_stopped])
        recorder(replace(step, number=number))
    force = np.array([item.step.infos["push"][0] for item in recorded[1:]]).reshape(-1, 2)  # world frame, N
    is_pushed = np.asarray(force.any(axis=1))
    push_starts = np.flatnonzero(is_pushed & ~np.append(False, is_pushed[:-1]))
    episodes = recorder.episodes()
    scenario = session.env.scenario
    if recorded[0].step.number != 0:
        scenario = replace(scenario, dropouts=None)  # their times are counted from the start of the episode
    return replace(
        episodes,
        push_step=push_starts[None],
        push_impulse=np.add.reduceat(force, push_starts)[np.newaxis] * episodes.dt,
        push_steps=int(is_pushed.sum()) // max(1, len(push_starts)),
        scenario=scenario,
    )
