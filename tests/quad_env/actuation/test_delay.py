"""Late and lost targets: the robot moves, to the bit, as one whose policy asks for what arrives."""

from typing import Any

import numpy as np
import pytest

from quad_env.actuation.runtime import ActionDelay
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Latency, SteadyForce
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario
from quad_env.task.observations import OBSERVATION, observation_table

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


@pytest.mark.parametrize("late", [1, 3])
def test_an_action_acts_exactly_so_many_steps_later(late: int) -> None:
    arriving = np.concatenate((np.tile(SIMPLE_QUAD.home_pose, (late, ROBOTS, 1)), ACTIONS[:-late]))
    delayed = observations(Scenario("late", latency=Latency(action=0.01 * late, observation=0.0)))
    np.testing.assert_array_equal(delayed[..., SENSED], observations(PLAIN, arriving)[..., SENSED])
    asked = delayed[1:, :, OBSERVATION["previous_action"]]
    np.testing.assert_array_equal(asked, (ACTIONS - SIMPLE_QUAD.home_pose).astype(np.float32))


@pytest.mark.parametrize("late", [1, 4])
def test_a_reading_is_seen_exactly_so_many_steps_later_and_nothing_else_is_late(late: int) -> None:
    true = observations(PLAIN)
    seen = observations(Scenario("late", latency=Latency(action=0.0, observation=0.01 * late)))
    np.testing.assert_array_equal(seen[late:, :, SENSED], true[:-late, :, SENSED])
    np.testing.assert_array_equal(seen[:late, :, SENSED], np.broadcast_to(true[0], (late, *true[0].shape))[..., SENSED])
    known = slice(SENSED.stop, None)
    np.testing.assert_array_equal(seen[..., known], true[..., known])


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


def test_robots_that_move_on_without_the_others_lose_their_own_targets() -> None:
    """Latency and dropouts of robots 1 and 3 of four, the latter 30 steps behind, are those of each by itself."""
    scenario = Scenario(
        "lost", latency=Latency(action=0.02), dropouts=Dropouts(count=2, duration=0.2, window=(0.2, 1.1))
    )
    episodes = [Episode(SIMPLE_QUAD, scenario, FIRST_SEED + robot, 0, 0.01) for robot in range(ROBOTS)]
    together, rows, behind = ActionDelay(SIMPLE_QUAD, scenario, ROBOTS, 0.01), np.array([1, 3]), np.array([0, 31])
    together.begin(np.arange(ROBOTS), episodes)
    alone = [ActionDelay(SIMPLE_QUAD, scenario, 1, 0.01) for _ in rows]
    for action_delay, robot in zip(alone, rows, strict=True):
        action_delay.begin(np.arange(1), [episodes[robot]])
    for step in range(31, STEPS):
        clock, targets = step - behind, ACTIONS[step]
        received = together.received(targets, clock, rows)[rows]
        expected = [
            action_delay.received(targets[robot : robot + 1], clock[place : place + 1], np.arange(1))[0]
            for place, (action_delay, robot) in enumerate(zip(alone, rows, strict=True))
        ]
        np.testing.assert_array_equal(received, expected)


def test_every_joint_drops_out_and_every_dropout_lies_in_its_window() -> None:
    scenario = Scenario("lost", dropouts=Dropouts(count=4, duration=0.5, window=(1.0, 9.0)))
    plans = [Episode(SIMPLE_QUAD, scenario, seed, 0, 0.01).dropouts for seed in range(100)]
    assert {int(joint) for plan in plans if plan for joint in plan.joint} == set(range(12))
    first = np.array([plan.first_step for plan in plans if plan])
    assert first.shape == (100, 4)
    assert ((first >= 100 + 200 * np.arange(4)) & (first + 50 <= 300 + 200 * np.arange(4))).all()


def test_a_steady_force_pushes_all_the_time_in_its_own_direction() -> None:
    env = SimpleQuadVectorEnv(64, Scenario("wind", force=SteadyForce(30.0)))
    env.reset(seed=0)
    applied = np.array([env.simulation.snapshot(robot).xfrc_applied[1] for robot in range(64)])
    np.testing.assert_allclose(np.hypot(applied[:, 0], applied[:, 1]), 30.0)
    assert np.abs(applied[:, 2:]).max() == 0
    assert np.hypot(*applied[:, :2].mean(axis=0)) < 10, "directions spread over the circle"
    for _ in range(30):
        env.step(np.tile(SIMPLE_QUAD.home_pose, (64, 1)))
    np.testing.assert_array_equal(applied, [env.simulation.snapshot(robot).xfrc_applied[1] for robot in range(64)])


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
