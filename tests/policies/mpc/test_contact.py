"""Contact forces and external wrenches estimated from joint torques, compared with the forces that MuJoCo applies."""

from typing import Any

import mujoco
import numpy as np
import pytest

import policies
from evaluate.hardware import HardwareConfig
from evaluate.rollouts.rollout import roll_out
from policies.contact.motion_state import MotionState, compute_motion_state
from policies.mpc.contact import ContactEstimator, wrench_to_acceleration
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from quad_env import OBSERVATION
from quad_env.actuation.hardware import hardware_profile
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.policies.readings import reading
from train.curriculum import with_terrain_seed

PERIOD, SUBSTEPS = 0.01, 5
DYNAMICS = Dynamics(SIMPLE_QUAD)
NO_LOAD = np.zeros((1, 6))


class Trotting:
    """The trot on flat ground, with an external force on the trunk, world frame, N."""

    def __init__(self, force: tuple[float, float, float] = (0.0, 0.0, 0.0), yaw: float = 0.0) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.mjcf))
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[3:7] = np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)
        self.trunk = self.model.body("base_link").id
        self.data.xfrc_applied[self.trunk, :3] = force
        self.policy = policies.make("trot")
        self.policy.reset()
        self.target = SIMPLE_QUAD.home_pose.copy()
        self.forces = np.zeros((4, 3))

    def observation(self) -> np.ndarray:
        return reading(
            projected_gravity=-self.rotation[2],
            angular_velocity=self.data.qvel[3:6],
            linear_velocity=self.rotation.T @ self.data.qvel[:3],
            joint_position=self.data.qpos[7:] - SIMPLE_QUAD.home_pose,
            joint_velocity=self.data.qvel[6:],
            previous_action=self.target - SIMPLE_QUAD.home_pose,
        )

    @property
    def rotation(self) -> np.ndarray:
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, self.data.qpos[3:7])
        return matrix.reshape(3, 3)

    def step(self) -> MotionState:
        """Simulate a control period; `forces` are then the mean contact forces of the feet, world frame, N."""
        self.target = self.policy.act(self.observation()).astype(np.float64)
        self.data.ctrl[:] = self.target
        self.forces = np.zeros((4, 3))
        for _ in range(SUBSTEPS):
            mujoco.mj_step(self.model, self.data)
            self.forces += self.contact_forces() / SUBSTEPS
        return compute_motion_state(SIMPLE_QUAD, DYNAMICS, self.observation()[None])

    def contact_forces(self) -> np.ndarray:
        """Return the contact force of the ground on each foot, world frame, (4, 3), N."""
        forces, one = np.zeros((4, 3)), np.zeros(6)
        feet = {geom: foot for foot, leg in enumerate(SIMPLE_QUAD.leg_names) for geom in foot_geoms(self.model, leg)}
        for number, contact in enumerate(self.data.contact):
            for place, geom in enumerate(contact.geom):
                if (foot := feet.get(int(geom))) is not None:
                    mujoco.mj_contactForce(self.model, self.data, number, one)
                    sign = 1.0 if place == 1 else -1.0  # the contact force acts on the second geom
                    forces[foot] += sign * (contact.frame.reshape(3, 3).T @ one[:3])
        return forces

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """Rotate world vectors into the level frame."""
        ahead = self.rotation[:2, 0] / np.linalg.norm(self.rotation[:2, 0])
        cos, sin = ahead
        return vectors @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def test_forces_of_the_feet_are_felt_without_sensors() -> None:
    robot, sense = Trotting(yaw=0.7), ContactEstimator(SIMPLE_QUAD, MpcParameters(), PERIOD)
    felt, true = [], []
    for step in range(150):
        now = robot.step()
        forces = sense.estimate(now, NO_LOAD)[0]
        if step >= 50:
            felt.append(forces)
            true.append(robot.turned(robot.forces))
    error = np.array(felt) - np.array(true)
    loaded = np.array(true)[..., 2] > 20.0
    assert loaded.mean() > 0.3
    assert np.sqrt((error[loaded] ** 2).mean(axis=0)).max() < 15.0
    assert np.abs(error[~loaded]).mean() < 5.0
    right = (np.array(felt)[..., 2] > MpcParameters().touch_force) == (
        np.array(true)[..., 2] > MpcParameters().touch_force
    )
    assert right.mean() > 0.97


@pytest.mark.parametrize("force", [(30.0, -10.0, 0.0), (0.0, 0.0, -60.0)])
def test_a_steady_force_on_the_trunk_is_felt_in_the_robot_s_own_frame(force: tuple[float, float, float]) -> None:
    robot = Trotting(force, yaw=0.7)
    sense = ContactEstimator(SIMPLE_QUAD, MpcParameters(disturbance_time=0.3, load_time=0.3), PERIOD)
    felt, true, accelerations = [], [], []
    for step in range(250):
        now = robot.step()
        sense.estimate(now, NO_LOAD)
        if step >= 150:
            felt.append(sense.wrench[0, :3])
            true.append(robot.turned(np.array(force)))
            accelerations.append(wrench_to_acceleration(now.bodies, now.rotation, sense.wrench)[0, :3])
    np.testing.assert_allclose(np.mean(felt, axis=0), np.mean(true, axis=0), atol=6.0)
    np.testing.assert_allclose(np.mean(accelerations, axis=0), np.mean(true, axis=0) / SIMPLE_QUAD.mass, atol=0.45)


@pytest.mark.parametrize("yaw_rate", [1.5, -1.5])
def test_a_robot_on_a_circle_is_pushed_to_the_centre(yaw_rate: float) -> None:
    """The centripetal force is m v ω, although the velocity is constant in the rotating frame."""
    sense, speed = ContactEstimator(SIMPLE_QUAD, MpcParameters(), PERIOD), np.array([0.8, 0.3])
    sense.reset(1)
    circling = reading(1, linear_velocity=(*speed, 0.0), angular_velocity=(0.0, 0.0, yaw_rate))
    forces, wrench = sense._solve_contact_forces(compute_motion_state(SIMPLE_QUAD, DYNAMICS, circling), False)
    still = compute_motion_state(SIMPLE_QUAD, DYNAMICS, reading(1, angular_velocity=(0.0, 0.0, yaw_rate)))
    sense.reset(1)
    at_rest, left = sense._solve_contact_forces(still, False)
    total = (forces - at_rest).sum(axis=1)[0] + (wrench - left)[0, :3]
    expected = SIMPLE_QUAD.mass * yaw_rate * np.array([-speed[1], speed[0], 0.0])
    np.testing.assert_allclose(total, expected, atol=0.5)


def test_a_push_is_hardly_taken_for_a_lasting_force() -> None:
    """The push is 35 N·s within 0.1 s; a large remainder a second later would make the robot lean against no force."""
    robot, sense = Trotting(), ContactEstimator(SIMPLE_QUAD, MpcParameters(), PERIOD)
    largest = 0.0
    for step in range(250):
        robot.data.xfrc_applied[robot.trunk, 1] = 350.0 if 100 <= step < 110 else 0.0
        sense.estimate(robot.step(), NO_LOAD)
        if step >= 100:
            largest = max(largest, float(np.abs(sense.wrench[0, :2]).max()))
    assert largest < 40.0
    assert np.abs(sense.wrench[0, :2]).max() < 10.0


def test_a_slip_lowers_what_is_relied_on_and_is_forgotten() -> None:
    parameters = MpcParameters(grip_memory=1.0)
    sense, velocity = ContactEstimator(SIMPLE_QUAD, parameters, PERIOD), np.zeros((2, 4, 3))
    sense.reset(2)
    forces = np.tile([8.0, 0.0, 80.0], (2, 4, 1))
    velocity[1, 2, 0] = 0.5  # one foot of the second robot slides, at a tenth of its load
    sense._estimate_friction(forces, velocity)
    assert (sense.friction_estimate == parameters.friction).all()  # a landing foot slides for a moment
    for _ in range(30):
        sense._estimate_friction(forces, velocity)
    assert sense.friction_estimate[0] == parameters.friction
    assert sense.friction_estimate[1] == pytest.approx(0.07, abs=0.03)
    for _ in range(300):
        sense._estimate_friction(forces, 0.0 * velocity)
    assert sense.friction_estimate[1] > 0.9 * parameters.friction


def test_what_pushes_stays_where_it_is_in_the_world() -> None:
    yaw_rate = -1.5
    sense = ContactEstimator(SIMPLE_QUAD, MpcParameters(), PERIOD)
    sense.wrench[:, :3] = 40.0, 10.0, -20.0
    now = Trotting().step()
    # No new contact is detected.
    tilted = now._replace(tilt=np.full((1, 2), 0.5), angular_velocity=np.array([[0.0, 0.0, yaw_rate]]))
    for _ in range(100):
        sense.estimate(tilted, NO_LOAD)
    cos, sin = np.cos(yaw_rate), np.sin(yaw_rate)  # rotation of the level frame in a second
    world = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ sense.wrench[0, :3]
    np.testing.assert_allclose(world, [40.0, 10.0, -20.0], atol=1e-9)


def test_zeros_of_encoders_are_known_from_legs_in_the_air() -> None:
    robot, sense = Trotting(), ContactEstimator(SIMPLE_QUAD, MpcParameters(), PERIOD, encoders=True)
    zero, angles = np.linspace(-0.01, 0.01, 12), robot.data.qpos[7:].copy()
    for _ in range(250):
        robot.step()
        seen = robot.observation()[None].copy()
        seen[:, OBSERVATION["joint_velocity"]] = (robot.data.qpos[7:] - angles) / PERIOD
        seen[:, OBSERVATION["joint_position"]] += zero
        angles = robot.data.qpos[7:].copy()
        sense.estimate(
            compute_motion_state(SIMPLE_QUAD, DYNAMICS, sense.remove_encoder_offsets(seen.astype(np.float32))), NO_LOAD
        )
    np.testing.assert_allclose(sense.encoder_offsets[0], zero, atol=0.004)


def test_contact_is_known_on_motors_and_encoders() -> None:
    """On the hardware profile, contact of loaded feet is detected within a control period.

    No contact is detected for feet in the air. Feet that lifted off in the previous period may still count as standing,
    since the forces are means of two periods.
    """
    real = hardware_profile(SIMPLE_QUAD)
    hardware = HardwareConfig(real.actuator, real.sensors, real.estimator)  # type: ignore[arg-type]
    policy, estimated, true = hardware.policy("mpc_wbc", on_hardware_profile=True), [], []
    assert isinstance(policy, MpcWbc)
    estimate = policy.contact_estimator.estimate

    def noted(*given: Any) -> np.ndarray:
        estimated.append((forces := estimate(*given))[..., 2])
        return forces

    policy.contact_estimator.estimate = noted  # type: ignore[method-assign]
    seeds = episode_seeds("search", 0, 4)
    watch = lambda step: true.append(step.infos["foot_impulse"] / PERIOD) if step.number else None  # noqa: E731
    roll_out(policy, with_terrain_seed("flat", "search"), seeds, watch, steps=200, hardware=hardware)
    late, settled = 1, 50
    found = np.array(estimated[settled + late + 1 :]) > policy.parameters.touch_force
    pressed = np.array(true[settled : len(estimated) - late - 1])
    before = np.array(true[settled - 1 : len(estimated) - late - 2])
    assert found[pressed > policy.parameters.touch_force].mean() >= 0.95
    assert found[(pressed == 0.0) & (before == 0.0)].mean() <= 0.01
    assert found[pressed == 0.0].mean() <= 0.05
