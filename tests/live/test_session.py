"""A session's robot is that of an episode, until it is steered or pushed or its policy changes."""

import numpy as np
import pytest

import policies
import quad_env
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from live.session import CHANGE, Session
from policies.base import PolicyError
from quad_env.robots.simple_quad import SIMPLE_QUAD


def session(name: str, scenario: str = "flat", seed: int = 3) -> Session:
    return Session(policies.make(name), scenario, seed=seed)


def test_left_alone_it_is_the_episode_of_the_rollout_to_the_bit() -> None:
    scenario = "push=42+rough=0.1"
    told: list[Step] = []
    roll_out(policies.make("trot"), scenario, np.array([3]), told.append, steps=80, terminate_on_fall=False)
    steps: list[Step] = []
    live = Session(policies.make("trot"), scenario, seed=3, observers=[steps.append])
    for _ in range(80):
        live.step()
    live.close()
    assert [step.number for step in steps] == [step.number for step in told]
    for ours, theirs in zip(steps, told, strict=True):
        assert np.array_equal(ours.observation, theirs.observation)
        assert np.array_equal(ours.action, theirs.action)


def test_it_goes_beyond_every_time_limit() -> None:
    live = session("trot")
    live.steer((0.4, 0.0, 0.0))
    start = live.latest.infos["position"][0].copy()
    for _ in range(1100):
        before, _ = live.latest.infos["position"][0], live.step()
    assert not np.array_equal(before, live.latest.infos["position"][0])
    assert np.linalg.norm(before - start) == pytest.approx(4.4, abs=0.9)
    live.close()


def test_a_command_by_hand_outlives_a_reset_until_it_is_given_back() -> None:
    live = session("trot")
    live.steer((0.0, 0.3, 0.0))
    live.reset()
    assert live.seed == 4
    assert np.array_equal(live.step().infos["command"], [[0.0, 0.3, 0.0]])
    live.steer(None)
    live.reset(seed=3)
    drawn = session("trot", seed=3)
    assert np.array_equal(live.step().infos["command"], drawn.step().infos["command"])
    for each in (live, drawn):
        each.close()


def test_a_policy_chosen_under_way_takes_over_without_a_jump() -> None:
    live = session("trot")
    live.steer((0.6, 0.0, 0.0))
    for _ in range(67):
        live.step()
    live.choose(policies.make("residual"))
    actions = [live.latest.action, *(live.step().action for _ in range(12))]
    live.choose(policies.make("trot_integral"))  # before the first has taken over
    actions += [live.step().action for _ in range(round(CHANGE / live.env.dt) + 5)]
    change = np.abs(np.diff(actions, axis=0))[:, 0].max(axis=1)
    assert change[[0, 12]] == pytest.approx(0.0, abs=1e-6)  # rad, of the first targets of each
    assert change.max() < 0.25  # walking changes targets by up to 0.18 rad a step
    assert live.policy.name == "trot_integral"
    live.choose(policies.make("stand"))
    for _ in range(round(CHANGE / live.env.dt) + 1):
        live.step()
    assert np.array_equal(live.latest.action[0], np.float32(SIMPLE_QUAD.home_pose))  # its own, once it has taken over
    assert not live.latest.infos["fall"].any()
    live.close()


def test_a_policy_of_another_robot_is_refused_and_nothing_has_changed() -> None:
    live = session("trot")
    with pytest.raises(ValueError, match="was made for"):
        live.choose(policies.make("trot", control_period=0.02))
    assert live.policy.name == "trot"
    sighted = policies.make("stand")
    sighted.height_scan = quad_env.HeightScan()
    with pytest.raises(PolicyError, match="other ground heights"):
        live.choose(sighted)
    live.close()
