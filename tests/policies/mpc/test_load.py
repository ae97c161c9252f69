"""Payloads in the whole-body dynamics, compared with MuJoCo's model of a robot with a payload."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from evaluate.rollouts.rollout import roll_out
from policies.contact.motion_state import MotionState
from policies.mpc.calibration import CALIBRATION_STEPS
from policies.mpc.motion import MAX_LOAD, MIN_LOAD, PointLoad, add_load, estimate_load
from policies.mpc.policy import MpcWbc
from quad_env import Scenario
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics, DynamicsTerms, _make_mujoco_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Payload
from quad_env.seeding import episode_seeds

MASS, PLACE = 12.0, np.array([0.13, -0.08, 0.17])
DYNAMICS = Dynamics(SIMPLE_QUAD)


@pytest.fixture
def state() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    orientation = rng.normal(size=4)
    return {
        "orientation": (orientation / np.linalg.norm(orientation))[None],
        "velocity": rng.normal(size=(1, 3)),
        "angular_velocity": rng.normal(size=(1, 3)),
        "angles": SIMPLE_QUAD.home_pose + rng.uniform(-0.4, 0.4, (1, 12)),
        "speeds": rng.normal(size=(1, 12)),
    }


def with_point_mass(state: dict[str, np.ndarray]) -> DynamicsTerms:
    """Return MuJoCo's dynamics of the robot with a point mass MASS at PLACE on its trunk."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    tiny = 1e-9
    load = {"name": "load", "pos": PLACE, "mass": MASS, "inertia": [tiny] * 3, "explicitinertial": True}
    spec.body("base_link").add_body(ipos=[0.0, 0.0, 0.0], **load)
    carrying = Dynamics(SIMPLE_QUAD)
    carrying.__dict__["_compiled"] = _make_mujoco_model(mujoco, spec.compile(), SIMPLE_QUAD.leg_names)
    return carrying.compute(**state)


def moving(bodies: DynamicsTerms, rotation: np.ndarray, generalised: np.ndarray) -> MotionState:
    """Return a motion with only the fields that the payload depends on."""
    others = dict.fromkeys(MotionState._fields)
    return MotionState(**others | {"bodies": bodies, "rotation": rotation, "generalised_velocity": generalised})  # type: ignore


def test_a_load_changes_the_bodies_as_mujoco_says(state: dict[str, np.ndarray]) -> None:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, state["orientation"][0])
    generalised = np.concatenate((state["velocity"], state["angular_velocity"], state["speeds"]), axis=1)
    load = PointLoad(np.array([MASS]), PLACE[None])
    found = add_load(moving(DYNAMICS.compute(**state), rotation.reshape(1, 3, 3), generalised), load).bodies
    for name, value in with_point_mass(state)._asdict().items():
        np.testing.assert_allclose(getattr(found, name), value, atol=1e-6, err_msg=name)


def test_a_level_robots_load_is_told_by_its_weight() -> None:
    load = PointLoad(np.array([MASS, 0.0]), np.stack((PLACE, (0.0, 0.0, PLACE[2]))))
    found = estimate_load(load.gravity_wrench(np.stack((np.eye(3),) * 2)), PLACE[2])
    np.testing.assert_allclose(found.mass, load.mass)
    np.testing.assert_allclose(found.position, load.position)


@pytest.mark.parametrize(("force", "mass"), [(30.0, 0.0), (-0.5 * MIN_LOAD * GRAVITY, 0.0), (-1e4, MAX_LOAD)])
def test_lift_and_what_the_model_may_be_wrong_by_are_no_load_and_the_largest_is_bounded(
    force: float, mass: float
) -> None:
    assert estimate_load(np.array([[0.0, 0.0, force, 0.0, 0.0, 0.0]]), 0.15).mass == mass


def test_a_walking_robot_feels_what_it_carries() -> None:
    scenario = Scenario("load", payload=Payload(15.0, reach=(0.0, 0.0)))
    env = gym.make("quad_env:SimpleQuad-v0", scenario=scenario)
    observation, _ = env.reset(seed=1, options={"command": (0.5, 0.0, 0.0)})
    policy = MpcWbc()
    policy.reset()
    felt = []
    for _ in range(150):
        observation, _, fell, _, _ = env.step(policy.act(observation))
        assert not fell
        felt.append(estimate_load(policy.contact_estimator.wrench, policy.parameters.load_height))
    assert np.mean([load.mass for load in felt[100:]]) == pytest.approx(15.0, rel=0.1)
    assert np.abs(np.mean([load.position[0, :2] for load in felt[100:]], axis=0)).max() < 0.03


def test_noise_is_no_load() -> None:
    """Readings with unknown noise give 100 N and more in the first update."""
    policy = MpcWbc()
    roll_out(policy, "noise=0.8", episode_seeds("search", 0, 4), steps=CALIBRATION_STEPS[1])
    assert np.abs(policy.contact_estimator.wrench[:, 2]).max() < 50.0
