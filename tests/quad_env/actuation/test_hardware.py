"""Hardware profile: its definition, its effect on the compiled model and the observations, and incompatible options."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import quad_env
from quad_env import ENV_ID, SIMPLE_QUAD
from quad_env.actuation.hardware import CURVES, ESTIMATOR, hardware_profile
from quad_env.actuation.models import ACTUATORS, Actuator, TorqueSpeed
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import compile_model
from quad_env.robots.registry import ROBOTS
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.scenario import Scenario
from quad_env.serialisation import from_json_values, to_json_values
from tests.robot_models import NEEDS_MODELS

PER_JOINT = TorqueSpeed((20.0, 30.0, 40.0), (10.0, 20.0, 5.0), (15.0, 30.0, 35.0))


def limits(curve: TorqueSpeed, torque_limit: float | None = None) -> np.ndarray:
    """Return the largest torque of each joint in the compiled model, (12,), N·m."""
    model = compile_model(SIMPLE_QUAD, Scenario("made", motors=Motors(torque_limit)), Actuator(curve))
    np.testing.assert_array_equal(model.actuator_forcerange[:, 0], -model.actuator_forcerange[:, 1])
    return model.actuator_forcerange[:, 1]


def test_three_figures_are_those_of_hip_thigh_and_calf_and_twelve_of_every_joint() -> None:
    np.testing.assert_array_equal(limits(PER_JOINT), np.tile((15.0, 30.0, 35.0), 4))
    np.testing.assert_array_equal(limits(PER_JOINT, 32.0), np.tile((15.0, 30.0, 32.0), 4))
    np.testing.assert_array_equal(limits(TorqueSpeed(tuple(range(1, 13)))), np.arange(1.0, 13.0))
    np.testing.assert_array_equal(PER_JOINT.resolve(SIMPLE_QUAD).slope, np.tile((2.0, 1.5, 8.0), 4))
    assert from_json_values(to_json_values(Actuator(PER_JOINT))) == Actuator(PER_JOINT)


def test_each_joints_torque_lies_on_its_own_line_within_its_own_peak() -> None:
    """The torque limits at 4 rad/s are 20 (1 − 0.4), 30 (1 − 0.2) and 40 (1 − 0.8) N·m."""
    model = compile_model(SIMPLE_QUAD, Scenario("made"), Actuator(PER_JOINT))
    data = mujoco.MjData(model)
    for speed, wanted in ((4.0, (12.0, 24.0, 8.0)), (0.0, (15.0, 30.0, 35.0)), (-4.0, (15.0, 30.0, 35.0))):
        mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
        data.qvel[6:], data.ctrl[:] = speed, model.actuator_ctrlrange[:, 1]
        mujoco.mj_forward(model, data)
        far = data.ctrl - data.qpos[7:] > 0.4
        np.testing.assert_allclose(data.actuator_force[far], np.tile(wanted, 4)[far])
        assert far.sum() >= 8


@pytest.mark.parametrize(
    ("figures", "words"), [((1.0, 2.0), "a number, or 3 or 12"), ((1.0, -2.0, 3.0), "more than 0")]
)
def test_figures_that_are_none_are_refused_in_a_line(figures: tuple[float, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        TorqueSpeed(figures)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_the_profile_reaches_the_compiled_model_and_the_observations(make) -> None:
    """5 ms of action delay are three physics steps of 2 ms."""
    env = make(ENV_ID, scenario="push:4+hardware")
    made, (_, infos) = env.unwrapped, env.reset(seed=0)
    model = made.simulation.model
    assert (made.scenario.name, made.scenario.axis, made.scenario.hardware) == ("push:4+hardware", "push", True)
    assert (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR).all()
    np.testing.assert_allclose(model.actuator_delay, 0.006)
    assert made.simulation.winding_temperature is not None
    assert made.estimator is not None
    assert type(made.estimator).__name__.lower().startswith(ESTIMATOR)
    assert "sensor_gyro" in infos
    env.close()
    ideal = make(ENV_ID, scenario="push:4")
    assert "sensor_gyro" not in ideal.reset(seed=0)[1]
    assert (ideal.unwrapped.simulation.model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED).all()
    ideal.close()


@pytest.mark.parametrize("given", [{"actuator": "motor"}, {"sensors": "ideal"}, {"estimator": "kalman"}])
def test_other_hardware_beside_the_profile_is_refused_in_a_line(given) -> None:
    for make in (SimpleQuadEnv, SimpleQuadVectorEnv):
        with pytest.raises(ValueError, match=r"^flat\+hardware has the robot's hardware profile: leave out actuator"):
            make(scenario="flat+hardware", **given)
        make(scenario="flat+hardware", actuator="ideal", sensors="truth", estimator="complementary").close()


def test_simple_quad_has_the_articles_motor_and_what_motor_has() -> None:
    actuator, sensors, _ = hardware_profile(SIMPLE_QUAD)
    assert actuator == Actuator(TorqueSpeed(), 66.0, 0.006, ACTUATORS["motor"].thermal)
    line = actuator.curve.resolve(SIMPLE_QUAD)
    assert {*line.stall_torque, *line.peak_torque} == {100.0}
    assert {*line.no_load_speed} == {10.0}
    assert sensors == "typical"


def test_a_users_robot_has_its_rated_torque_and_speed_whatever_it_is_called() -> None:
    mine = quad_env.Robot.from_mjcf(SIMPLE_QUAD.mjcf, "go1", home_pose=SIMPLE_QUAD.home_pose, rated_torque=50.0)
    actuator = hardware_profile(mine).actuator
    assert (actuator.curve, actuator.thermal) == (TorqueSpeed(), None)
    assert set(actuator.curve.resolve(mine).peak_torque) == {50.0}


@NEEDS_MODELS
@pytest.mark.parametrize("name", CURVES)
def test_a_named_robot_has_the_motors_that_its_maker_publishes(name: str) -> None:
    """20.2 N·m at 13.5 rad/s is between the peak of the current and the no-load speed of 30 rad/s."""
    env = SimpleQuadEnv(scenario="flat+hardware", robot=name)
    np.testing.assert_array_equal(env.simulation.model.actuator_forcerange[:3, 1], (23.7, 23.7, 35.55))
    line = CURVES[name].resolve(ROBOTS[name])
    hip = line.stall_torque[0] * (1.0 - 13.5 / line.no_load_speed[0])
    assert hip == pytest.approx(20.2, rel=0.01)
    np.testing.assert_allclose(line.stall_torque[2] / line.stall_torque[0], 1.5, rtol=1e-2)
    env.close()
