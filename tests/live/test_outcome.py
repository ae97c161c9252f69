"""The outcome so far is the outcome that the evaluator gives the same episode when it ends there."""

import numpy as np
import pytest

import policies
import quad_env
from evaluate.measures.metrics import outcome
from evaluate.rollouts.rollout import roll_out, run
from live.outcome import OutcomeSoFar
from live.session import Session

EPISODES = (("trot", "flat"), ("document_repaired", "flat"), ("document", "flat"), ("trot", "rough=0.3"))


@pytest.mark.parametrize(("policy", "scenario"), EPISODES)
def test_at_the_end_of_an_episode_it_is_the_outcome_of_the_evaluation(policy: str, scenario: str) -> None:
    seeds = np.arange(2)
    so_far = OutcomeSoFar()
    found = quad_env.scenario(scenario)
    roll_out(policies.make(policy), found, seeds, so_far, terminate_on_fall=False)
    judged = outcome(run(policies.make(policy), found, seeds))
    assert so_far.words() == [each.replace("_", " ") for each in judged]


def test_it_follows_commands_given_by_hand() -> None:
    so_far = OutcomeSoFar()
    live = Session([policies.make("trot"), policies.make("stand")], "flat", seed=1, observers=[so_far])
    live.steer((0.5, 0.0, 0.0))
    for _ in range(90):
        live.step()
    assert so_far.words() == ["upright", "upright"]
    for _ in range(210):
        live.step()
    assert so_far.words() == ["succeeded", "refused"]
    live.reset()
    assert so_far.words() == ["upright", "upright"]
    live.close()
