"""Robots in Drake have the mass, the stance and the payload of MuJoCo's; they repeat to the bit, in any batch."""

import mujoco
import numpy as np
import pytest

from quad_env.actuation.models import ACTUATORS
from quad_env.config import GRAVITY
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import simulators
from quad_env.physics.model import compile_model
from quad_env.physics.simulation import Simulation, SimulationConfig
from quad_env.physics.simulators import check_simulator
from quad_env.robots.registry import get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from quad_env.scenarios.scenario import with_hardware_profile

pytest.importorskip("pydrake")
from quad_env.physics.drake.batch import DrakeBatch
from tests.robot_models import NEEDS_MODELS

MODELS = [
    ("simple_quad", "flat"),
    ("simple_quad", "payload=10"),
    *(pytest.param(robot, "flat", marks=NEEDS_MODELS) for robot in ("go1", "go2")),
]


@pytest.mark.parametrize(("name", "on"), MODELS)
def test_mass_matrix_is_mujocos(name: str, on: str) -> None:
    robot = get_robot(name)
    model = compile_model(robot, scenario(on, robot))
    rng, data, mass = np.random.default_rng(0), mujoco.MjData(model), np.zeros((model.nv, model.nv))
    robots = DrakeBatch(model, 1)
    drake, context = robots._drake, robots._contexts[0]
    if on != "flat":
        model.body_pos[model.body("payload").id] += (0.1, -0.05, 0.0)
        robots.expand("body_pos")[0] = model.body_pos
        robots.set_const(np.arange(1))
    orientation = rng.normal(size=4)
    data.qpos[:] = (0.1, 0.2, 3.0, *orientation, *(robot.home_pose + 0.1 * rng.normal(size=12)))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    drake.plant.SetPositionsAndVelocities(context, robots._to_drake(data.qpos, np.zeros(18)))
    into = np.column_stack([robots._to_drake(data.qpos, column)[19:] for column in np.eye(18)])
    np.testing.assert_allclose(into.T @ drake.plant.CalcMassMatrix(context) @ into, mass, rtol=0.0, atol=1e-12)


def test_it_stands_as_in_mujoco() -> None:
    """The pose agrees to 0.5 mm and 0.001 rad, the torques to 0.2 N·m; the feet carry the weight."""
    simulations = [
        Simulation(SIMPLE_QUAD, scenario("flat"), SimulationConfig(has_meter=True, simulator=name))
        for name in simulators.SIMULATORS
    ]
    home = SIMPLE_QUAD.home_pose[None]
    for each in simulations:
        each.reset(np.arange(1), np.zeros((1, 35)))
        for _ in range(100):
            each.step(home, None)
    mine, drakes = simulations
    np.testing.assert_allclose(drakes.qpos[0, :3], mine.qpos[0, :3], atol=5e-4)
    np.testing.assert_allclose(drakes.qpos[0, 3:], mine.qpos[0, 3:], atol=1e-3)
    np.testing.assert_allclose(drakes.torque, mine.torque, atol=0.2)
    feet, shins = drakes.ground_contacts()
    assert feet.all()
    assert not shins.any()
    assert drakes.meter is not None
    impulse = SIMPLE_QUAD.mass * GRAVITY / 100.0
    assert drakes.meter.readings["foot_impulse"].sum() == pytest.approx(impulse, rel=0.02)


@pytest.mark.parametrize("on", ["push=35", "payload=10", "stairs=0.1"])
def test_a_robot_is_the_same_alone_and_in_a_batch_and_again(on: str) -> None:
    def states(count: int, row: int) -> np.ndarray:
        env = SimpleQuadVectorEnv(count, on, readings=True, simulator="drake")
        env.reset(seed=[3, 4][2 - count :], options={"command": (0.5, 0.0, 0.0)})
        rng, home = np.random.default_rng(0), env.robot.home_pose
        for _ in range(12):
            action = home + rng.uniform(-0.3, 0.3, 12)
            env.step(np.tile(action, (count, 1)))
        assert not env.simulation.read_coordinates()[1].any()
        return np.concatenate((env.simulation.qpos[row], env.simulation.qvel[row], env.simulation.torque[row]))

    alone = states(1, 0)
    np.testing.assert_array_equal(states(1, 0), alone)
    np.testing.assert_array_equal(states(2, 1), alone)


def test_a_single_environment_runs_in_it_and_shows_its_payload() -> None:
    env = SimpleQuadEnv("payload=10", simulator="drake")
    env.reset(seed=0)
    _, reward, terminated, *_ = env.step(env.robot.home_pose.astype(np.float32))
    assert np.isfinite(reward)
    assert not terminated
    np.testing.assert_array_equal(env.data.qpos, env.simulation.qpos[0])


def test_what_drake_gives_up_on_is_reported() -> None:
    model = compile_model(SIMPLE_QUAD, scenario("flat"))
    robots = DrakeBatch(model, 2)
    robots.reset(np.arange(2), keyframe=0)
    robots.bind("qvel")[1] = np.nan
    robots.step(None, 1)
    assert robots.warning[:, :, 1].sum(axis=1).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"on": "rough"}, "ground of 'rough'"),
        ({"on": "soft"}, "soft ground of 'soft'"),
        ({"on": "weak_motors"}, "motors of 'weak_motors'"),
        ({"actuator": "motor"}, "motors other than ideal"),
        ({"sensors": True}, "sensors"),
        ({"simulator": "bullet"}, "valid: mujoco, drake"),
    ],
)
def test_anything_else_is_refused_in_a_line(asked: dict[str, str], named: str) -> None:
    wanted = {"simulator": "drake", "on": "flat", "actuator": "ideal", "sensors": False} | asked
    with pytest.raises(ValueError, match=named) as refused:
        check_simulator(
            wanted["simulator"], scenario(wanted["on"]), ACTUATORS[wanted["actuator"]], bool(wanted["sensors"])
        )
    assert "\n" not in str(refused.value)


def test_the_hardware_profile_and_own_servo_gains_are_refused() -> None:
    with pytest.raises(ValueError, match="hardware profile"):
        SimpleQuadEnv(with_hardware_profile(scenario("flat")), simulator="drake")
    with pytest.raises(ValueError, match="servo gains"):
        SimpleQuadVectorEnv(2, servo=(np.array([[300.0] * 12, [200.0] * 12]), 10.0), simulator="drake")


def test_without_the_package_the_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulators, "find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"pip install -e \"\.\[drake\]\""):
        check_simulator("drake", scenario("flat"), ACTUATORS["ideal"])
