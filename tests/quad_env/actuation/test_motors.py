"""Torque limit, bandwidth and payload, each measured."""

import math

import numpy as np
import pytest

from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Motors, Payload
from quad_env.scenarios.scenario import Scenario

TARGET = SIMPLE_QUAD.home_pose + 0.1


def start(simulation: Simulation, loads: np.ndarray | None = None) -> Simulation:
    robots = len(simulation._qpos)
    simulation.reset(np.arange(robots), np.zeros((robots, 35)), load=loads)
    return simulation


def largest_torque(motors: Motors) -> float:
    simulation, rng = (
        start(Simulation(SIMPLE_QUAD, Scenario("made", motors=motors), 1, 1, 100.0)),
        np.random.default_rng(0),
    )
    torques = []
    for _ in range(50):
        simulation.step(rng.uniform(SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper, (1, 12)), None)
        torques.append(simulation.state_of_one((0.0, 0.0, 0.0), simulation.motion_of_one()).joint_torque)
    return float(np.abs(torques).max())


@pytest.mark.parametrize("limit", [8.0, 40.0, 100.0])
def test_torque_reaches_its_limit_and_never_goes_above(limit: float) -> None:
    assert largest_torque(Motors(torque_limit=limit)) == limit


@pytest.mark.parametrize("bandwidth", [2.0, 10.0])
def test_a_slow_servo_goes_63_percent_of_a_step_in_one_time_constant(bandwidth: float) -> None:
    """Torque kp (heard - q) - kv q̇ tells what target the servo goes by."""
    simulation = start(Simulation(SIMPLE_QUAD, Scenario("made", motors=Motors(bandwidth=bandwidth)), 1, 1, 100.0))
    for step in range(1, 21):
        simulation.step(TARGET[None], None)
        data = simulation.snapshot(0)
        heard = (data.actuator_force + 10 * data.qvel[6:]) / 300 + data.qpos[7:]
        share = 1 - math.exp(-0.01 * step * 2 * math.pi * bandwidth)
        np.testing.assert_allclose(heard, SIMPLE_QUAD.home_pose + share * 0.1, atol=1e-9)


def test_a_restarted_robot_with_slow_servos_stands() -> None:
    simulation = start(Simulation(SIMPLE_QUAD, Scenario("made", motors=Motors(bandwidth=2.0)), 2, 1, 100.0))
    for _ in range(30):
        simulation.step(np.tile(TARGET, (2, 1)), None)
    start(simulation).step(np.tile(SIMPLE_QUAD.home_pose, (2, 1)), None)
    assert np.abs(simulation.state(np.zeros((3, 2))).joint_torque).max() < 15


def test_a_payload_adds_its_mass_where_it_is() -> None:
    loads = np.array([(0.2, 0.0), (-0.1, 0.1)])
    simulation = start(Simulation(SIMPLE_QUAD, Scenario("made", payload=Payload(6.0)), 2, 1, 100.0), loads)
    for robot, load in enumerate(loads):
        data = simulation.snapshot(robot)
        trunk = simulation.model.body("base_link").id
        assert simulation.model.body_subtreemass[trunk] == pytest.approx(SIMPLE_QUAD.mass + 6.0)
        along, left = data.subtree_com[trunk, :2] - data.xpos[trunk, :2]
        legs = com_of_the_bare_robot()
        np.testing.assert_allclose(
            (along, left), (6 * load + SIMPLE_QUAD.mass * legs) / (SIMPLE_QUAD.mass + 6), atol=1e-9
        )


def com_of_the_bare_robot() -> np.ndarray:
    data = start(Simulation(SIMPLE_QUAD, Scenario("made"), 1, 1, 100.0)).snapshot(0)
    return np.array(data.subtree_com[1, :2] - data.xpos[1, :2])


def test_a_payloads_mass_is_where_its_cube_is_drawn() -> None:
    payload = Payload(6.0)
    simulation = start(
        Simulation(SIMPLE_QUAD, Scenario("made", payload=payload), 1, 1, 100.0), np.array([(0.1, -0.05)])
    )
    data, cube = simulation.snapshot(0), simulation.model.body("payload").id
    geom = simulation.model.geom("payload").id
    np.testing.assert_allclose(data.xipos[cube], data.geom_xpos[geom], atol=1e-12)
    top = SIMPLE_QUAD.trunk_size[2] / 2
    assert data.xipos[cube, 2] - data.xpos[1, 2] == pytest.approx(top + payload.edge / 2)


def test_the_legs_under_a_payload_carry_it() -> None:
    simulation = start(
        Simulation(SIMPLE_QUAD, Scenario("made", payload=Payload(6.0)), 2, 1, 100.0),
        np.array([(0.2, 0.0), (-0.2, 0.0)]),
    )
    for _ in range(100):
        simulation.step(np.tile(SIMPLE_QUAD.home_pose, (2, 1)), None)
    knees = np.array(simulation.state(np.zeros((3, 2))).joint_torque)[2::3]
    # Between hips 0.5 m apart, 6 kg moves by 0.4 m: 0.8 of it goes to the other pair; the lever is 0.3 sin(0.5) m.
    moved = 0.8 * 6.0 * 9.81 * 0.3 * np.sin(0.5)
    assert knees[:2, 0].sum() - knees[:2, 1].sum() == pytest.approx(moved, rel=0.25)
    assert knees[2:, 0].sum() - knees[2:, 1].sum() == pytest.approx(-moved, rel=0.25)


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Motors, {"torque_limit": 0.0}),
        (Motors, {"torque_limit": np.inf}),
        (Motors, {"bandwidth": -1.0}),
        (Payload, {"mass": 0.0}),
        (Payload, {"edge": np.nan}),
        (Payload, {"reach": (-0.1, 0.1)}),
    ],
)
def test_nonsense_is_refused_by_name(kind: type, wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        kind(**wrong)
