"""A session's robot equals that of an episode until a user steers it, pushes it or changes its policy."""

import numpy as np
import pytest

import policies
import quad_env
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from live.session import POLICY_BLEND_TIME, Session
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
    live.set_policy(policies.make("residual"))
    actions = [live.latest.action, *(live.step().action for _ in range(12))]
    live.set_policy(policies.make("trot_integral"))  # before the end of the first blend
    actions += [live.step().action for _ in range(round(POLICY_BLEND_TIME / live.env.dt) + 5)]
    change = np.abs(np.diff(actions, axis=0))[:, 0].max(axis=1)
    assert change[[0, 12]] == pytest.approx(0.0, abs=1e-6)  # rad, the first targets of each blend
    assert change.max() < 0.25  # walking changes targets by up to 0.18 rad a step
    assert live.policy.name == "trot_integral"
    live.set_policy(policies.make("stand"))
    for _ in range(round(POLICY_BLEND_TIME / live.env.dt) + 1):
        live.step()
    assert np.array_equal(live.latest.action[0], np.float32(SIMPLE_QUAD.home_pose))  # its own target, after the blend
    assert not live.latest.infos["fall"].any()
    live.close()


def test_a_policy_that_has_walked_elsewhere_begins_anew_where_it_is_chosen() -> None:
    """Clock and memory are reset: the actions equal those of a new policy."""
    walked = policies.make("trot_integral")
    elsewhere = Session(walked, "rough", seed=5, command=(0.8, 0.0, 0.3))
    for _ in range(33):
        elsewhere.step()
    lives = [session("stand"), session("stand")]
    for live, policy in zip(lives, (walked, policies.make("trot_integral")), strict=True):
        live.steer((0.4, 0.0, 0.0))
        live.step()
        live.set_policy(policy)
    for _ in range(60):
        first, second = (live.step() for live in lives)
        np.testing.assert_array_equal(first.action, second.action)
    for live in (*lives, elsewhere):
        live.close()


def test_a_reset_begins_the_policy_anew_and_ends_its_taking_over() -> None:
    """An episode after a change of policy equals an episode with this policy from the start."""
    live, fresh = session("stand"), session("trot", seed=4)
    live.set_policy(policies.make("trot"))
    for _ in range(7):
        live.step()
    live.reset()
    assert (live.seed, live.user_intervened) == (4, False)
    for _ in range(30):
        np.testing.assert_array_equal(live.step().action, fresh.step().action)
    for each in (live, fresh):
        each.close()


def test_a_person_s_doings_are_told_and_known_until_the_next_episode() -> None:
    told: list[str] = []
    live = session("stand")
    live.listeners.append(told.append)
    assert not live.user_intervened
    for do in (
        lambda: live.push((30.0, -40.0), 0.1),
        lambda: live.steer((0.1, 0.0, 0.0)),
        lambda: live.set_policy(policies.make("trot")),
    ):
        do()
        assert live.user_intervened
        live.reset(seed=9)
        assert not live.user_intervened
    assert told == ["pushed by hand, 5 N·s", "reset, seed 9", "reset, seed 9", "trot chosen", "reset, seed 9"]
    live.close()


def test_a_policy_of_another_robot_is_refused_and_nothing_has_changed() -> None:
    live = session("trot")
    with pytest.raises(ValueError, match="was made for"):
        live.set_policy(policies.make("trot", control_period=0.02))
    assert live.policy.name == "trot"
    sighted = policies.make("stand")
    sighted.height_scan = quad_env.HeightScan()
    with pytest.raises(PolicyError, match="other ground heights"):
        live.set_policy(sighted)
    live.close()
