"""What a policy does in a second does not depend on how often it is asked, and a wrong rate is refused."""

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
"""What rates of change and blends that end between two steps leave, rad."""
SLACK_OF = {"mpc_wbc": 0.05}
"""The same of a gait that moves its joints by little."""
LEAPS = 0.05
"""Share of the times at which a motion begins with a leap that may come a step later."""
LEAPS_OF = {"mpc_wbc_bound": 0.2, "mpc_wbc": 0.15, "trot_feedback": 0.1}
"""The same of gaits by what the feet feel, and of one that lifts its feet twice in a cycle of which a half is no whole
number of such steps."""
WAITING = 0.6
"""For how long at most a policy that does not know its delay waits for legs to move, which they never do here, s."""
IN_TIME = {*LEAPS_OF, *(name for name in UNTRAINED if not name.startswith(("stand", "crouch", "mpc")))}


def shown(policy, observation):
    """The observation with the scan that the policy wants, of which nothing is seen."""
    unseen = table_with(policy.robot, policy.height_scan).size - OBSERVATION_SIZE
    return np.pad(observation, ((0, 0), (0, unseen)), constant_values=UNSEEN)


def ask(policy, observation, seconds):
    """Actions of so long, (steps, 12)."""
    observation = shown(policy, observation)
    return np.array([policy.act(observation)[0] for _ in range(round(seconds / policy.control_period))])


def assert_the_same_in_time(often, seldom, slack=SLACK, leaps=LEAPS):
    """Actions at 100 Hz and at 50 Hz are the same at the same times but for leaps, and move a joint by far more."""
    same = (np.abs(often[1::2] - seldom) <= slack).all(axis=1)
    assert same.mean() >= 1.0 - leaps
    assert np.ptp(seldom, axis=0).max() >= 3.0 * slack


@pytest.mark.parametrize("name", UNTRAINED)
def test_the_clock_advances_by_its_frequency_times_the_control_period(name):
    for period in (0.005, 0.02):
        policy = policies.make(name, control_period=period)
        if isinstance(policy, GaitedPolicy):
            policy.act(shown(policy, AT_REST))
            frequency = getattr(policy, "clock_rate", [policy.frequency])[0]
            assert policy.phase[0] == pytest.approx(2.0 * np.pi * frequency * period)


@pytest.mark.parametrize("name", sorted(IN_TIME))
def test_a_policy_asks_for_the_same_at_the_same_time_whatever_its_control_period(name):
    made = [policies.make(name, control_period=period) for period in (0.01, 0.02)]
    waiting, walking = (WAITING, 1.6) if isinstance(made[0], ModelBased) else (0.0, 0.8)
    asked = (ask(each, WALKING, waiting + walking)[round(waiting / each.control_period) :] for each in made)
    assert_the_same_in_time(*asked, SLACK_OF.get(name, SLACK), LEAPS_OF.get(name, LEAPS))


CHANGES = {
    "gait": (partial(policies.make, "gaits"), methodcaller("request", "bound"), WALKING, 1.2, 1.2),
    "jump": (partial(Behaviour, follow=False), methodcaller("request", "jump"), AT_REST, 0.2, 0.4),
    "recover": (partial(Behaviour, State.RECOVER, False), methodcaller("reset"), ON_ITS_BACK, 0.2, 0.4),
    "stop": (partial(policies.make, "safe:trot"), methodcaller("emergency_stop"), AT_REST, 0.2, 0.8),
}
"""What is made, what is requested of it, what it reads, and seconds before and after the request."""


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
