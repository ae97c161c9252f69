"""Late and lost targets: the robot moves, to the bit, as one whose policy asks for what arrives."""

from typing import Any

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Latency, SteadyForce
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario
from quad_env.task.observations import observation_table

SENSED = observation_table(SIMPLE_QUAD).sensed

ROBOTS, STEPS, FIRST_SEED = 4, 120, 5
SHOWN = np.random.default_rng(0).normal(0, 0.1, (STEPS, ROBOTS, 12))
ACTIONS = np.clip(SIMPLE_QUAD.home_pose + SHOWN, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)


def observations(scenario: Scenario, actions: np.ndarray = ACTIONS) -> np.ndarray:
    """At the start and after every step, (steps + 1, robots, 63)."""
    env = SimpleQuadVectorEnv(ROBOTS, scenario, terminate_on_fall=False)
    first, _ = env.reset(seed=FIRST_SEED)
    return np.array([first] + [env.step(action)[0] for action in actions])


PLAIN = Scenario("plain")


def test_a_late_action_is_shown_as_asked_and_nothing_but_what_is_sensed_is_late() -> None:
    true = observations(PLAIN)
    seen = observations(Scenario("late", latency=Latency(action=0.0, observation=0.04)))
    np.testing.assert_array_equal(seen[4:, :, SENSED], true[:-4, :, SENSED])
    known = slice(SENSED.stop, None)
    np.testing.assert_array_equal(seen[..., known], true[..., known])
    delayed = observations(Scenario("late", latency=Latency(action=0.03, observation=0.0)))
    np.testing.assert_array_equal(delayed[..., known], true[..., known])


def test_a_joint_that_hears_nothing_holds_its_last_target() -> None:
    dropouts = Dropouts(count=2, duration=0.2, window=(0.2, 1.1))
    scenario = Scenario("lost", dropouts=dropouts)
    received = ACTIONS.copy()
    for robot in range(ROBOTS):
        plan = Episode(SIMPLE_QUAD, scenario, FIRST_SEED + robot, 0, 0.01).dropouts
        assert plan is not None
        for first, joint in zip(plan.first_step, plan.joint, strict=True):
            received[first : first + 20, robot, joint] = received[first - 1, robot, joint]
    assert (received != ACTIONS).sum() == ROBOTS * 2 * 20
    lost = observations(scenario)
    np.testing.assert_array_equal(lost[..., SENSED], observations(PLAIN, received)[..., SENSED])
    assert (lost != observations(PLAIN)).any()


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Latency, {"action": -0.01}),
        (Latency, {"observation": np.nan}),
        (Dropouts, {"duration": 3.0}),
        (Dropouts, {"count": -1}),
        (SteadyForce, {"force": np.inf}),
    ],
)
def test_nonsense_is_refused(kind: type, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"must|fit"):
        kind(**wrong)
