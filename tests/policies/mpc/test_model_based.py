"""Joint targets and torques of the model-based controllers, by hand."""

import numpy as np
import pytest

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.gait_cycle import LegCycle
from policies.mpc.contact import ContactState
from policies.mpc.footing import ground_velocity
from policies.mpc.policy import MpcWbc
from policies.mpc.whole_body import Torques
from quad_env.actuation.models import Actuator, TorqueSpeed
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

MOTOR = Actuator(TorqueSpeed(stall_torque=100.0, no_load_speed=10.0, peak_torque=80.0))
SPEEDS = np.tile([0.0, 5.0, -5.0, 8.0], 3)


def turning(robots: int = 1, **readings: object) -> MotionState:
    """Return robots with joints that rotate at SPEEDS."""
    rows = reading(robots, joint_velocity=SPEEDS, **readings)
    return compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), rows)


def policy_of(actuator: Actuator = MOTOR, robots: int = 1) -> MpcWbc:
    policy = MpcWbc(actuator=actuator)
    policy.reset(num_envs=robots)
    return policy


def test_motors_are_asked_for_what_they_give_at_the_speeds_of_the_joints() -> None:
    """The limit is 100 (1 - 5 / 10) = 50 N·m forward, 20 N·m at 8 rad/s, and the peak of 80 N·m at rest or braking."""
    least, most = policy_of()._torque_limits(turning())
    np.testing.assert_allclose(most[0, :4], [80.0, 50.0, 80.0, 20.0])
    np.testing.assert_allclose(least[0, :4], [-80.0, -80.0, -50.0, -80.0])


def found(torque: float = 0.0, acceleration: float = 0.0, robots: int = 1) -> Torques:
    each = np.ones((robots, 12))
    return Torques(torque * each, acceleration * each, np.ones(robots, np.bool_))


def test_joint_targets_give_the_torques_halfway_through_the_control_period() -> None:
    """k (u - q - 5 ms q̇ - ½ (5 ms)² q̈) - d (q̇ + 5 ms q̈) = τ, with k = 300 and d = 10: for 6 N·m at 40 rad/s²."""
    policy, now = policy_of(), turning()
    assert not policy._invert_servo_law(now, found(6.0, 40.0)).any()
    angle = SIMPLE_QUAD.home_pose + 0.005 * SPEEDS + 0.0005
    np.testing.assert_allclose(policy._targets[0], angle + 6.0 / 300.0 + 10.0 / 300.0 * (SPEEDS + 0.2), atol=1e-6)


def test_no_joint_is_taken_to_accelerate_faster_than_2000() -> None:
    policy, now = policy_of(robots=2), turning(2)
    policy._invert_servo_law(now, found(0.0, 2000.0, 2))
    fastest = policy._targets.copy()
    policy._invert_servo_law(now, found(0.0, 1e6, 2))
    np.testing.assert_array_equal(policy._targets, fastest)


def test_a_robot_without_finite_torques_keeps_its_targets_and_the_other_gets_its_own() -> None:
    policy, now = policy_of(robots=2), turning(2)
    policy._invert_servo_law(now, found(1.0, robots=2))
    before, broken = policy._targets.copy(), found(2.0, robots=2)
    broken.torque[0, 3] = np.nan
    assert policy._invert_servo_law(now, broken).tolist() == [True, False]
    np.testing.assert_array_equal(policy._targets[0], before[0])
    np.testing.assert_allclose(policy._targets[1] - before[1], 1.0 / 300.0, atol=1e-9)
    broken = found(3.0, robots=2)._replace(has_solution=np.array([True, False]))
    assert policy._invert_servo_law(now, broken).tolist() == [False, True]


def test_a_robot_that_is_off_its_command_steps_faster_by_and_by() -> None:
    """The clock rate rises by 2 Hz per m/s of error beyond 0.4 m/s, at most by 1.5 Hz, with a gain of 0.3 a step."""
    policy = policy_of(robots=3)
    policy.parameters = policy.parameters.__class__(frequency_gain=2.0, most_faster=1.5)
    policy.frequency = 2.5
    policy._frequencies = np.full(3, 2.5)
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(3))
    now = now._replace(
        velocity=np.array([[0.3, 0.0, 0.0], [0.6, -0.8, 0.0], [3.0, 0.0, 0.0]]), command=np.zeros((3, 3))
    )
    phase = policy._phase.copy()
    policy._advance_gait_clock(now)
    frequencies = [2.5, 2.5 + 0.3 * 1.2, 2.5 + 0.3 * 1.5]
    np.testing.assert_allclose(policy._frequencies, frequencies)
    np.testing.assert_allclose((policy._phase - phase) / (2.0 * np.pi * 0.01), frequencies)


def test_a_robot_is_stopped_after_a_tenth_of_a_second_without_solutions_in_a_row_and_no_other() -> None:
    policy, observation, angles = policy_of(robots=2), reading(2), np.tile(SIMPLE_QUAD.home_pose, (2, 1))
    for step in range(14):
        policy._stop_failed_robots(np.array([True, step % 6 > 0]), observation, angles)
        assert policy.stopped.tolist() == [step >= 10, False]


def test_ground_is_cleared_the_more_the_rougher_the_footprints_are() -> None:
    """The clearance in mid-swing is 16 · (¼)² = 1 times the gain times the roughness, and zero at its ends."""
    policy = policy_of()
    policy.parameters = policy.parameters.__class__(roughness_gain=3.0)
    policy.terrain_estimator.roughness[:] = 0.02
    now = turning()
    ground = policy.terrain_estimator.ground(now, np.ones((1, 4), np.bool_))
    rough = float(policy.terrain_estimator.roughness[0])
    assert rough == pytest.approx(0.02, rel=0.02)
    over, zero = policy._swing_terrain(np.zeros((1, 4, 2)), ground), np.zeros((1, 4))
    np.testing.assert_allclose(over(zero, zero, zero + 0.5) - ground.at(zero, zero), 3.0 * rough)
    np.testing.assert_allclose(over(zero, zero, zero + np.array([0.0, 1.0, 0.0, 1.0])), ground.at(zero, zero))


def moving_feet(robots: int = 1) -> MotionState:
    """Return robots at (0.4, -0.2, 0.1) m/s and 0.5 rad/s, with resting joints."""
    rows = reading(robots, linear_velocity=(0.4, -0.2, 0.1), angular_velocity=(0.0, 0.0, 0.5))
    return compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), rows)


FIRST_SWINGS = np.array([[True, False, False, True]])


def flat(x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.full(x.shape, -0.4)


def accelerations(
    policy: MpcWbc,
    now: MotionState,
    progress: float,
    standing: list[int],
    late: list[int],
    swings: np.ndarray = FIRST_SWINGS,
) -> np.ndarray:
    """Return the planned foot accelerations at a progress, the same for all four feet; two feet swing."""
    cycle = LegCycle(swings, np.full((1, 4), progress))
    states = ContactState(*(np.array([each], np.bool_) for each in (standing, late, standing)))
    return policy._foot_accelerations(now, cycle, states, now.bodies.feet[..., :2] + 0.1, flat)[0]


def test_standing_feet_are_to_rest_and_late_ones_to_come_down() -> None:
    """Standing feet get -20 / s of their velocity; late feet get 30 / s towards a downward velocity of 0.5 m/s."""
    policy, now = policy_of(), moving_feet()
    policy.parameters = policy.parameters.__class__(stance_damping=20.0, swing_damping=30.0, search_speed=0.5)
    found, velocity = accelerations(policy, now, 0.5, [0, 1, 0, 0], [0, 0, 1, 0]), now.foot_velocity[0]
    np.testing.assert_allclose(found[1], -20.0 * velocity[1], atol=1e-9)
    np.testing.assert_allclose(found[2], 30.0 * (np.array([0.0, 0.0, 0.1 - 0.5]) - velocity[2]), atol=1e-6)


def test_swinging_feet_follow_their_path_from_where_they_were_lifted() -> None:
    """Swing feet get the path's acceleration, 300 / s² of the position error and 30 / s of the velocity error.

    The desired velocity is the path's velocity plus the velocity of the point that moves with the robot.
    """
    policy, now = policy_of(), moving_feet()
    policy.parameters = p = policy.parameters.__class__(
        swing_stiffness=300.0, swing_damping=30.0, duty=0.6, step_height=0.1, landing_depth=0.0
    )
    policy._frequencies = np.array([2.0])
    accelerations(policy, now, 0.0, [0, 1, 1, 0], [0] * 4)
    lifted = now.bodies.feet[0, :, :2].copy()
    bodies = now.bodies._replace(feet=now.bodies.feet + np.array([0.03, -0.01, 0.05]))
    later = now._replace(bodies=bodies)
    found = accelerations(policy, later, 0.5, [0, 1, 1, 0], [0] * 4)
    np.testing.assert_allclose(policy._liftoff_position[0, [0, 3]], lifted[[0, 3]])
    time, feet = (1.0 - 0.6) / 2.0, later.bodies.feet[0]
    aim, past = feet[:, :2] + 0.1, ground_velocity(later, later.command[:, 2])[0]
    for foot in (0, 3):
        place = np.array([*(lifted[foot] + aim[foot]) / 2.0, -0.4 + 0.1])
        rate = np.array([*(1.5 * (aim[foot] - lifted[foot]) - 0.5 * past[foot] * time) / time, 0.0])
        t = 0.5 + 0.01 / time
        then = 6.0 * t * (1.0 - t) * (aim[foot] - lifted[foot]) + (1.0 - 6.0 * t + 6.0 * t * t) * past[foot] * time
        rise = 0.1 * 2.0 * 4.0 * t * (1.0 - t) * 4.0 * (1.0 - 2.0 * t)
        ahead = (np.array([*then, rise]) / time - rate) / 0.01
        x, y, _ = place
        velocity = later.bodies.com_velocity[0]
        along = np.array([velocity[0] - 0.5 * y, velocity[1] + 0.5 * x, 0.1])
        by_hand = ahead + 300.0 * (place - feet[foot]) + 30.0 * (along + rate - later.foot_velocity[0, foot])
        np.testing.assert_allclose(found[foot], by_hand, rtol=1e-4, atol=0.02)
    assert p.duty == 0.6


def test_a_foot_that_is_lifted_again_starts_from_there() -> None:
    policy, now = policy_of(), moving_feet()
    for swings in (FIRST_SWINGS, ~FIRST_SWINGS, FIRST_SWINGS):
        now = now._replace(bodies=now.bodies._replace(feet=now.bodies.feet + 0.02))
        accelerations(policy, now, 0.3, [0] * 4, [0] * 4, swings)
    np.testing.assert_allclose(policy._liftoff_position[0, [0, 3]], now.bodies.feet[0, [0, 3], :2])
    np.testing.assert_allclose(policy._liftoff_position[0, [1, 2]], now.bodies.feet[0, [1, 2], :2] - 0.02)


def test_contacts_are_of_where_the_legs_were_when_the_readings_were_taken() -> None:
    """Three control steps ago at 2.5 Hz, the phase was 0.075 cycles less; each robot has its own delay."""
    policy = policy_of(robots=2)
    policy._frequencies = np.array([2.5, 2.5])
    policy.observer.delay_estimator.delays = np.array([0, 3])
    phase = 2.0 * np.pi * 0.4
    policy._phase = np.array([phase, phase + 2.0 * np.pi * 0.075])
    earlier = policy._cycle_at_measurement()
    np.testing.assert_allclose(earlier.progress[0], earlier.progress[1], atol=1e-9)
    np.testing.assert_array_equal(earlier.swing[0], policy._gait.legs(np.array(phase)).swing)


def test_robots_that_give_up_stop_from_their_own_targets_at_their_own_joints() -> None:
    """The second of two robots, in another posture than the first, stops in the same way as it stops alone."""
    together, alone = policy_of(robots=2), policy_of()
    angles = np.tile(SIMPLE_QUAD.home_pose, (2, 1))
    angles[1] += 0.1
    rows = reading(2, projected_gravity=[(0.0, 0.0, -1.0), (0.2, 0.1, -0.97)])
    together._targets, alone._targets = angles + 0.05, angles[1:] + 0.05
    for step in range(20):
        together._stop_failed_robots(np.array([False, True]), rows, angles)
        alone._stop_failed_robots(np.array([True]), rows[1:], angles[1:])
        assert together.stopped.tolist() == [False, step >= 10]
        np.testing.assert_array_equal(together._targets[1], alone._targets[0])
    np.testing.assert_array_equal(together._targets[0], angles[0] + 0.05)
