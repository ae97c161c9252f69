"""Outcome of the episode that is shown: undecided until the robot falls or the episode's time is over, then its story
with the cause, by the rules of an evaluation."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from evaluate.causes.story import in_lines, timeline
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import STEPS, EpisodeRecorder
from live.session import Session

_Kept = tuple[Step, Any, bool]
"""A control step, the policy's failure by then, and whether its safety layer was stopping the robot."""


class EpisodeOutcome:
    """Keeps the latest control steps of a session's episode, from its start on, and says what came of it."""

    def __init__(self, session: Session) -> None:
        self.story: list[str] = []
        """Moments of the episode, the outcome and its cause last; empty while nothing is decided."""
        self._session, self._ended = session, False
        self._kept: deque[_Kept] = deque(maxlen=STEPS + 1)
        self.record()

    def record(self) -> None:
        """Keep the control step just taken."""
        if self._ended:
            return
        step, policy = self._session.latest, self._session.policy
        failure = getattr(policy, "failure", None)
        self._kept.append((step, failure, bool(np.any(getattr(policy, "stopped", False)))))
        fallen = step.infos["fall"][0] > 0 or step.infos["diverged"][0]
        self._ended = bool(fallen or (failure is not None and failure[0]))
        if self._ended or (step.number == STEPS and not self._session.user_intervened):
            self.story = _story(list(self._kept), self._session)

    @property
    def words(self) -> str:
        """What is known by now."""
        if self.story:
            return self.story[-1].replace("  ", ": ", 1)
        if self._session.user_intervened:
            return "no outcome: steered, pushed or changed by hand"
        return f"undecided until {STEPS * self._session.env.dt:g} s"

    @property
    def failed(self) -> bool:
        """Whether it is decided, and no success."""
        return bool(self.story) and not self.story[-1].endswith(SUCCEEDED)


def _story(kept: Sequence[_Kept], session: Session) -> list[str]:
    """Lines of `evaluate.causes.story` of the kept steps, with the times of the episode."""
    episodes = _record(kept, session)
    begun = kept[0][0].number * episodes.dt
    return in_lines((begun + time, words) for time, words in timeline(episodes, measure(episodes)))


def _record(kept: Sequence[_Kept], session: Session) -> Episodes:
    """The kept steps as a record whose first is the start, with the pushes by hand."""
    policy: Any = SimpleNamespace()
    recorder = EpisodeRecorder(policy, np.array([session.seed]), STEPS)
    for number, (step, failure, stopped) in enumerate(kept):
        policy.failure, policy.stopped = failure, np.array([stopped])
        recorder(replace(step, number=number))
    force = np.array([step.infos["push"][0] for step, *_ in kept[1:]]).reshape(-1, 2)  # N, world
    pushed = np.asarray(force.any(axis=1))
    begins = np.flatnonzero(pushed & ~np.append(False, pushed[:-1]))
    episodes, scenario = recorder.episodes(), session.env.scenario
    return replace(
        episodes,
        push_step=begins[None],
        push_impulse=np.add.reduceat(force, begins)[np.newaxis] * episodes.dt,
        push_steps=int(pushed.sum()) // max(1, len(begins)),
        scenario=scenario if kept[0][0].number == 0 else replace(scenario, dropouts=None),  # whose times are gone
    )
