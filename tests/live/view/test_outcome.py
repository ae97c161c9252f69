"""The displayed outcome equals that of an evaluation, with its cause; before it is decided, none is displayed."""

from contextlib import closing

import numpy as np
import pytest

import policies
from evaluate.causes.story import in_lines, timeline
from evaluate.measures.metrics import measure
from evaluate.rollouts.rollout import STEPS, run
from live.session import Session
from live.view.outcome import EpisodeOutcome


def watched(session: Session, steps: int, max_steps: int = STEPS) -> EpisodeOutcome:
    outcome = EpisodeOutcome(session, max_steps)
    for _ in range(steps):
        session.step()
        outcome.record()
    return outcome


@pytest.mark.parametrize(("name", "scenario"), [("residual", "rough=0.5"), ("trot", "push=300")])
def test_a_fall_has_the_story_and_the_cause_of_an_evaluation_and_keeps_it(name: str, scenario: str) -> None:
    episodes = run(policies.make(name), scenario, np.array([1]))
    fall = int(episodes.fall_step[0]) + 1
    assert fall < STEPS
    with closing(Session(policies.make(name), scenario, seed=1)) as session:
        outcome = watched(session, fall - 1)
        assert outcome.words == "undecided until 10 s"
        assert not outcome.failed
        session.step()
        outcome.record()
        assert outcome.story == in_lines(timeline(episodes, measure(episodes)))
        assert outcome.failed
        assert "; cause: " in outcome.words
        before = outcome.words
        session.push((500.0, 0.0), 0.1)
        session.step()
        outcome.record()
        assert outcome.words == before  # although the robot continues and is pushed


def test_success_is_said_at_the_end_of_the_time_and_never_of_what_was_steered() -> None:
    with closing(Session(policies.make("stand"), command=(0.0, 0.0, 0.0))) as session:
        outcome = watched(session, 149, 150)
        assert outcome.words == "undecided until 1.5 s"
        session.step()
        outcome.record()
        assert (outcome.words, outcome.failed) == ("1.50 s: succeeded", False)
        session.reset()
        session.push((0.0, 0.0), 0.1)
        assert session.user_intervened
        session.reset()
        session.steer((0.5, 0.0, 0.0))
        outcome = watched(session, 151, 150)
        assert outcome.words == "no outcome: steered, pushed or changed by hand"


def test_a_push_by_hand_long_after_the_start_is_a_cause_and_times_are_those_of_the_episode() -> None:
    with closing(Session(policies.make("stand"))) as session:
        session.steer(np.zeros(3))
        outcome = watched(session, 0, 200)
        for number in range(300):
            if number == 220:
                session.push((0.0, 1500.0), 0.1)
            session.step()
            outcome.record()
    assert outcome.story[0] == "2.20 s  a push of 150 N·s, 10.6 m/s for its mass"
    assert outcome.words.endswith("cause: pushed over (certain)")
