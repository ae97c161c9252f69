"""A policy acts equally over time at any control period; a wrong control rate is refused."""

import dataclasses
from functools import partial
from operator import methodcaller

import numpy as np
import pytest

import policies
from policies.base import GaitedPolicy
from policies.behaviour import Behaviour, State
from policies.bundle import save
from policies.mpc.model_based import ModelBased
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from quad_env import OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import UNSEEN, table_with
from tests.policies.readings import reading

UNTRAINED = [name for name in policies.names() if name not in policies.TRAINED]
AT_REST, WALKING = reading(1), reading(1, command=(0.4, 0.1, 0.2))
ON_ITS_BACK = -AT_REST
SLACK = 0.08
"""rad. Difference from rate limits and blends that end between two steps."""
SLACK_OF = {"mpc_wbc": 0.05}
"""rad. Difference for a gait with small joint motions."""
LEAPS = 0.05
"""Share of steps in which a motion may start with a jump that comes one step later."""
LEAPS_OF = {"mpc_wbc_bound": 0.2, "mpc_wbc": 0.15, "trot_feedback": 0.1}
"""Share of these steps for gaits that use contact forces, and for a gait with an odd number of steps in a cycle."""
WAITING = 0.6
"""s. Largest time that a policy waits for leg motion when its delay is unknown; the legs never move in these tests."""
IN_TIME = {*LEAPS_OF, *(name for name in UNTRAINED if not name.startswith(("stand", "crouch", "mpc")))}


def shown(policy, observation):
    """Return the observation with an empty height scan, if the policy has one."""
    unseen = table_with(policy.robot, policy.height_scan).size - OBSERVATION_SIZE
    return np.pad(observation, ((0, 0), (0, unseen)), constant_values=UNSEEN)


def ask(policy, observation, seconds):
    """Return the actions over a time, s, (steps, 12)."""
    observation = shown(policy, observation)
    return np.array([policy.act(observation)[0] for _ in range(round(seconds / policy.control_period))])


def assert_the_same_in_time(often, seldom, slack=SLACK, leaps=LEAPS):
    """Check that actions at 100 Hz and at 50 Hz agree at equal times except for jumps, and move a joint by far more."""
    same = (np.abs(often[1::2] - seldom) <= slack).all(axis=1)
    assert same.mean() >= 1.0 - leaps
    assert np.ptp(seldom, axis=0).max() >= 3.0 * slack


@pytest.mark.parametrize("name", UNTRAINED)
def test_the_clock_advances_by_its_frequency_times_the_control_period(name):
    for period in (0.005, 0.02):
        policy = policies.make(name, control_period=period, servo="own")
        if isinstance(policy, GaitedPolicy):
            policy.act(shown(policy, AT_REST))
            frequency = getattr(policy, "clock_rate", [policy.frequency])[0]
            assert policy.phase[0] == pytest.approx(2.0 * np.pi * frequency * period)


@pytest.mark.parametrize("name", sorted(IN_TIME))
def test_a_policy_asks_for_the_same_at_the_same_time_whatever_its_control_period(name):
    made = [policies.make(name, control_period=period, servo="own") for period in (0.01, 0.02)]
    waiting, walking = (WAITING, 1.6) if isinstance(made[0], ModelBased) else (0.0, 0.8)
    asked = (ask(each, WALKING, waiting + walking)[round(waiting / each.control_period) :] for each in made)
    assert_the_same_in_time(*asked, SLACK_OF.get(name, SLACK), LEAPS_OF.get(name, LEAPS))


CHANGES = {
    "gait": (partial(policies.make, "gaits"), methodcaller("request", "bound"), WALKING, 1.2, 1.2),
    "jump": (partial(Behaviour, follow=False), methodcaller("request", "jump"), AT_REST, 0.2, 0.4),
    "recover": (partial(Behaviour, State.RECOVER, False), methodcaller("reset"), ON_ITS_BACK, 0.2, 0.4),
    "stop": (partial(policies.make, "safe:trot"), methodcaller("emergency_stop"), AT_REST, 0.2, 0.8),
}
"""Change -> policy, request, observation, and s before and after the request."""


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_takes_the_same_time(change):
    make, ask_for_it, observation, before, after = CHANGES[change]
    seen = []
    for period in (0.01, 0.02):
        policy = make(control_period=period)
        first = ask(policy, observation, before)
        ask_for_it(policy)
        seen.append(np.concatenate((first, ask(policy, observation, after))))
    assert_the_same_in_time(*seen)


@pytest.mark.parametrize("period", [0.0, -0.01, np.inf, np.nan])
def test_a_control_period_is_a_time(period):
    with pytest.raises(ValueError, match="control_period"):
        policies.make("trot", control_period=period)


def test_a_policy_of_another_control_period_or_robot_is_refused_with_the_remedy():
    trot = policies.make("trot")
    trot.check_compatible(SIMPLE_QUAD, 0.01)
    with pytest.raises(ValueError, match=r'(?s)0.01 s.*0.02 s.*make\("trot".*control_period=env.unwrapped.dt'):
        trot.check_compatible(SIMPLE_QUAD, 0.02)
    with pytest.raises(ValueError, match=r"made for simple_quad.*not for longer.*robot=env.unwrapped.robot"):
        trot.check_compatible(dataclasses.replace(SIMPLE_QUAD, name="longer", calf_length=0.31), 0.01)


def test_policies_within_a_policy_are_of_its_control_period():
    assert policies.Safe(policies.make("trot", control_period=0.02)).control_period == 0.02


def test_a_trained_policy_knows_its_control_period_and_is_refused_at_another(tmp_path):
    base = policies.make("trot", control_period=0.02)
    network = Network((np.zeros((Features(base).width, 12), np.float32),), (np.zeros(12, np.float32),))
    save(tmp_path, ResidualPolicy(base, network), {}, "unknown")
    found = policies.resolve(tmp_path, control_period=0.02)
    assert (found.robot, found.control_period, found.base.control_period) == (SIMPLE_QUAD, 0.02, 0.02)
    with pytest.raises(policies.PolicyError, match=r"made for simple_quad with a control period of 0.02 s"):
        policies.resolve(tmp_path)
    with pytest.raises(policies.PolicyError, match=r"made for simple_quad with a control period of 0.01 s"):
        policies.make("residual", control_period=0.02)
