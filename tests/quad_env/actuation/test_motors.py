"""Torque limit, bandwidth and payload, each measured."""

import numpy as np
import pytest

from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Motors, Payload
from quad_env.scenarios.scenario import Scenario

TARGET = SIMPLE_QUAD.home_pose + 0.1


def start(simulation: Simulation, loads: np.ndarray | None = None) -> Simulation:
    robots = len(simulation.qpos)
    simulation.reset(np.arange(robots), np.zeros((robots, 35)), load=loads)
    return simulation


def test_a_restarted_robot_with_slow_servos_stands() -> None:
    simulation = start(Simulation(SIMPLE_QUAD, Scenario("made", motors=Motors(bandwidth=2.0)), 2, 1, 100.0))
    for _ in range(30):
        simulation.step(np.tile(TARGET, (2, 1)), None)
    start(simulation).step(np.tile(SIMPLE_QUAD.home_pose, (2, 1)), None)
    assert np.abs(simulation.state(np.zeros((3, 2))).joint_torque).max() < 15


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
