from dataclasses import replace

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from policies.gait_cycle import TROT_OFFSETS, Gait
from policies.legs.kinematics import foot_positions
from policies.trot.open_loop import Trot, TrotParameters, compensate_servo_load, searched_parameters
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.policies.readings import feet, reading

# The nominal path: no compensation, an identity for the command map, and no wait for the command.
BARE = TrotParameters(
    frequency=2.5,
    duty=0.5,
    body_height=0.4,
    step_height=0.08,
    stance_width=0.42,
    stance_shift=-0.02,
    servo_lead=0.0,
    stance_load=0.0,
    blend_time=0.3,
    linear_acceleration=1e6,
    yaw_acceleration=1e6,
    turn_lead=0.0,
    forward_gain=1.0,
    forward_bias=0.0,
    lateral_gain=1.0,
    yaw_gain=1.0,
    yaw_per_lateral=0.0,
)


def steady(parameters, command, steps=80, settle=40):
    """Return actions (steps, 12) and phases (steps,) at a constant command, after the blend."""
    policy = Trot(parameters)
    for _ in range(settle):
        policy.act(reading(command=command))
    rows = [(policy.act(reading(command=command)), policy.phase[0]) for _ in range(steps)]
    return np.array([action for action, _ in rows], dtype=np.float64), np.array([phase for _, phase in rows])


@pytest.mark.parametrize("command", [(0.0, 0.0, 1.0), (-0.6, 0.4, -0.8)])
def test_standing_feet_move_against_the_commanded_velocity_at_their_place(command):
    actions, phases = steady(BARE, command)
    path, swing = feet(actions), Gait(TROT_OFFSETS).legs(phases).swing
    velocity = np.diff(path, axis=0) / 0.01
    standing = ~swing[:-1] & ~swing[1:]
    vx, vy, yaw_rate = command
    for leg in range(4):
        # r is the foot position in mid-stride: hips at x = ±0.25, shifted by -0.02, feet 0.21 m to the side.
        x, y = (0.23, 0.23, -0.27, -0.27)[leg], (0.21, -0.21, 0.21, -0.21)[leg]
        expected = [-(vx - yaw_rate * y), -(vy + yaw_rate * x), 0.0]
        np.testing.assert_allclose(
            velocity[standing[:, leg], leg], np.tile(expected, (standing[:, leg].sum(), 1)), atol=1e-3
        )


def test_zero_command_steps_in_place_to_the_step_height():
    path = feet(steady(BARE, (0.0, 0.0, 0.0))[0])
    np.testing.assert_allclose(path[:, :, 0], np.tile([0.23, 0.23, -0.27, -0.27], (80, 1)), atol=1e-6)
    np.testing.assert_allclose(path[:, :, 1], np.tile([0.21, -0.21, 0.21, -0.21], (80, 1)), atol=1e-6)
    np.testing.assert_allclose(path[:, :, 2].min(axis=0), -0.4, atol=1e-6)
    np.testing.assert_allclose(path[:, :, 2].max(axis=0), -0.32, atol=1e-4)


def test_mirrored_command_half_a_cycle_later_gives_the_mirrored_action():
    parameters = searched_parameters()
    parameters = replace(parameters, frequency=2.5)  # half a cycle is 20 whole ticks
    left, _ = steady(parameters, (0.7, 0.4, -0.9))
    right, _ = steady(parameters, (0.7, -0.4, 0.9))
    mirror = left.reshape(-1, 4, 3)[:, [1, 0, 3, 2]] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(right.reshape(-1, 4, 3)[20:], mirror[:-20], atol=1e-5)


def test_command_is_followed_no_faster_than_the_acceleration_limits():
    # 4 m/s² and 6 rad/s²: after 10 ticks 0.4 m/s of the 1 m/s, 0.4 m/s of the -0.5, and 0.6 rad/s of the 1.2.
    slow = Trot(replace(BARE, linear_acceleration=4.0, yaw_acceleration=6.0))
    settled = Trot(BARE)
    for _ in range(60):
        slow.act(reading()), settled.act(reading())
    for _ in range(10):
        late = slow.act(reading(command=(1.0, -0.5, 1.2)))
        expected = settled.act(reading(command=(0.4, -0.4, 0.6)))
    np.testing.assert_allclose(late, expected, atol=1e-6)
    for _ in range(20):
        late = slow.act(reading(command=(1.0, -0.5, 1.2)))
        expected = settled.act(reading(command=(1.0, -0.5, 1.2)))
    np.testing.assert_allclose(late, expected, atol=1e-6)


MAP = {"forward_gain": 1.2, "forward_bias": 0.1, "lateral_gain": 0.9, "yaw_gain": 1.5, "yaw_per_lateral": -0.2}


@pytest.mark.parametrize(
    ("changes", "command", "expected"),
    [
        (MAP, (0.5, 0.4, -0.6), (0.7, 0.36, -0.98)),  # 1.2·0.5 + 0.1; 0.9·0.4; 1.5·(-0.6) - 0.2·0.4
        ({"turn_lead": 0.1}, (1.0, 0.5, 0.8), (0.96, 0.58, 0.8)),  # 1 - 0.1·0.8·0.5; 0.5 + 0.1·0.8·1
    ],
)
def test_the_command_that_is_followed_by_hand(changes, command, expected):
    mapped, plain = Trot(replace(BARE, **changes)), Trot(BARE)
    for _ in range(50):
        asked, plainly = mapped.act(reading(command=command)), plain.act(reading(command=expected))
    np.testing.assert_allclose(asked, plainly, atol=1e-6)


def test_it_sets_out_from_the_home_pose():
    policy = Trot(BARE)
    actions = np.array([policy.act(reading(command=(1.5, 0.8, 1.2))) for _ in range(30)])
    assert np.abs(actions[0] - SIMPLE_QUAD.home_pose).max() < 0.01
    assert np.abs(np.diff(actions, axis=0)).max() < 0.2


def test_servo_lead_runs_ahead_along_the_tangent():
    bare, _ = steady(BARE, (0.6, 0.2, 0.4))
    led, _ = steady(replace(BARE, servo_lead=0.02), (0.6, 0.2, 0.4))
    np.testing.assert_allclose(
        led[1:],
        np.clip(bare[1:] + 2.0 * np.diff(bare, axis=0), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper),
        atol=1e-5,
    )


def test_targets_of_a_loaded_leg_differ_by_the_work_of_the_force():
    # Virtual work: the torque on joint i is F ∂z/∂q_i, here by central differences of the forward kinematics.
    joints, force, h = np.array([[0.1, 0.7, -1.3], [-0.2, 0.4, -0.9], [0.3, 0.2, -0.8], [0.0, 0.9, -1.6]]), 70.0, 1e-6
    stiffness = np.arange(100.0, 220.0, 10.0).reshape(4, 3)
    robot, foot = SIMPLE_QUAD.with_servo(stiffness.ravel(), 10.0), foot_positions(SIMPLE_QUAD, joints)
    arguments = *joints.T, foot[:, 0], foot[:, 1], np.full(4, force)
    targets = np.stack(compensate_servo_load(robot, *arguments), axis=-1)
    legs_first = compensate_servo_load(robot, *(each[:, None] for each in arguments), leg_axis=0)
    np.testing.assert_array_equal(np.stack(legs_first, axis=-1)[:, 0], targets)
    for joint in range(3):
        step = h * np.eye(3)[joint]
        slope = (
            foot_positions(SIMPLE_QUAD, joints + step)[:, 2] - foot_positions(SIMPLE_QUAD, joints - step)[:, 2]
        ) / (2 * h)
        np.testing.assert_allclose(
            targets[:, joint] - joints[:, joint], -force * slope / stiffness[:, joint], atol=1e-8
        )


def walk(seeds, scenario):
    """Return the measures of 5 s of the shipped trot."""
    return measure(rollout.run(policies.make("trot"), scenario, seeds, steps=500))


def test_it_follows_commands_over_the_whole_range_without_falling():
    measures = walk(episode_seeds("search", 1, 16), "flat")
    assert not measures.fell.any()
    # The commands cover the range.
    assert np.ptp(measures.commands, axis=(0, 1)) == pytest.approx([2.5, 1.6, 2.4], rel=0.3)
    assert measures.velocity_error.mean() <= 0.20
    assert measures.mean_velocity_error.mean() <= 0.12
    assert measures.yaw_rate_error.mean() <= 0.35


def test_the_shipped_trot_gives_these_actions():
    """The last bits differ between processors; a change of parameters or formulas exceeds the tolerance by far."""
    rng = np.random.default_rng(11)
    policy = policies.make("trot")
    policy.reset(16)
    for _ in range(20):
        command = rng.uniform([-1.0, -0.8, -1.2], [1.5, 0.8, 1.2], (16, 3))
        for _ in range(25):
            action = policy.act(reading(16, command=command))
    legs = [[0.065947, 1.5, -2.082401], [-0.111987, 1.179002, -2.387846], [-0.061249, 1.310344, -2.450294]]
    np.testing.assert_allclose(action[3], [*legs[0], *legs[1], *legs[2], 0.034696, 1.5, -2.094196], atol=2e-6)
