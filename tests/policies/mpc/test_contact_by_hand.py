"""Contacts, lasting wrench and friction of each robot, by hand."""

from typing import Any

import numpy as np
import pytest

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.gait_cycle import LegCycle
from policies.mpc.contact import ContactEstimator, ContactState, classify_contacts, wrench_to_acceleration
from policies.mpc.motion import PointLoad, PositionFeedback, estimate_load
from policies.mpc.parameters import MpcParameters
from quad_env import OBSERVATION
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

P = MpcParameters(touch_force=15.0, early_force=20.0)


def states(
    legs: list[tuple[bool, float, bool, float, float]], new: bool = False, *, flies: bool = True
) -> ContactState:
    """Return the contact states of one robot.

    Each leg is given by swing and progress now, swing and progress at the reading, and its force, N.
    """
    swing, progress, swung, gone, force = (np.array([each]) for each in zip(*legs, strict=True))
    return classify_contacts(P, LegCycle(swing, progress), LegCycle(swung, gone), force, np.array([new]), flies=flies)


STANDS, FLIES = (False, 0.3, False, 0.2, 60.0), (True, 0.3, True, 0.2, 0.0)


@pytest.mark.parametrize(
    ("leg", "standing", "late", "landed"),
    [
        (STANDS, True, False, True),
        ((False, 0.3, False, 0.2, 15.0), False, True, False),  # at most the touch force: still on its way down
        ((False, 0.5, False, 0.4, 0.0), True, False, False),  # half of its stance is over
        ((False, 0.1, True, 0.9, 0.0), True, False, False),  # the leg swung at the time of the reading
        (FLIES, False, False, False),
        ((True, 0.8, True, 0.7, 21.0), True, False, True),  # early landing
        ((True, 0.8, True, 0.6, 21.0), False, False, False),  # too early for a landing
        ((True, 0.8, True, 0.7, 20.0), False, False, False),
        ((True, 0.1, False, 0.9, 60.0), False, False, False),  # the leg stood at the time of the reading
    ],
)
def test_a_leg_stands_is_late_or_has_landed_by_its_cycle_and_its_force(
    leg: tuple[bool, float, bool, float, float], standing: bool, late: bool, landed: bool
) -> None:
    found = states([leg, STANDS, STANDS, STANDS])
    assert [bool(each[0, 0]) for each in found] == [standing, late, landed]
    assert all(found.stance[0, 1:])
    assert not found.late[0, 1:].any()


def test_feet_of_a_new_robot_show_the_ground_and_none_of_them_is_late() -> None:
    found = states([(False, 0.3, False, 0.2, 0.0), FLIES, STANDS, STANDS], new=True)
    assert found.stance[0].tolist() == [True, False, True, True]
    assert not found.late.any()
    assert found.landed.all()


def test_the_gait_s_feet_bear_a_robot_that_nothing_else_bears_unless_its_gait_flies() -> None:
    late = (False, 0.3, False, 0.2, 0.0)
    legs = [late, FLIES, FLIES, late]
    assert not states(legs).stance.any()
    assert states(legs, flies=False).stance[0].tolist() == [True, False, False, True]
    two = [LegCycle(*(np.array([[leg[at] for leg in each] for each in (legs, [STANDS, *legs[1:]])]) for at in pair))
           for pair in ((0, 1), (2, 3))]  # fmt: skip
    force = np.array([[0.0] * 4, [60.0, 0.0, 0.0, 0.0]])
    found = classify_contacts(P, *two, force, np.zeros(2, np.bool_), flies=False)
    assert found.stance.tolist() == [[True, False, False, True], [True, False, False, False]]


class Felt(ContactEstimator):
    """Contact estimator with given contact forces and wrenches."""

    given: tuple[np.ndarray, np.ndarray]

    def _solve_contact_forces(self, motion: MotionState, in_mid_swing: Any) -> tuple[np.ndarray, np.ndarray]:
        return self.given


def felt(robots: int = 2) -> Felt:
    sense = Felt(SIMPLE_QUAD, MpcParameters(disturbance_time=0.99, load_time=0.19), 0.01)
    sense.reset(robots)
    return sense


def at(robots: int = 2, **readings: Any) -> MotionState:
    return compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(robots, **readings))


def firm(robots: int = 2, up: float = 60.0) -> np.ndarray:
    """Return contact forces of two feet with the normal force `up` each, N."""
    forces = np.zeros((robots, 4, 3))
    forces[:, [0, 3], 2] = up
    return forces


def test_a_wrench_is_at_first_a_mean_and_then_taken_in_by_its_time() -> None:
    """The first gains are 1 / 5 and 1 / 6, the last 0.01 / (0.01 + 0.99) horizontally and 0.01 / 0.2 vertically."""
    sense, wrench = felt(), np.array([[20.0, -10.0, -30.0, 1.0, 2.0, 3.0], [0.0] * 6])
    sense.given = firm(), wrench
    sense.estimate(at(), np.zeros((2, 6)))
    np.testing.assert_allclose(sense.wrench, wrench / 5.0)
    sense.estimate(at(), np.zeros((2, 6)))
    np.testing.assert_allclose(sense.wrench, wrench * (0.2 + 0.8 / 6.0))
    sense._sample_count[:] = 1000.0
    sense.wrench[:] = 0.0
    sense.estimate(at(), np.zeros((2, 6)))
    np.testing.assert_allclose(sense.wrench, wrench * ([0.01, 0.01, 0.05, 0.01, 0.01, 0.01]))


def test_a_wrench_is_that_of_the_load_and_what_else_there_is_within_bounds() -> None:
    sense = felt(3)
    weight = np.array([[0.0, 0.0, -100.0, 0.0, 0.0, 0.0], [0.0] * 6, [0.0] * 6])
    wrench = np.array(
        [[0.0, 0.0, -50.0, 0.0, 0.0, 0.0], [90.0, -95.0, 70.0, 20.0, -20.0, 16.0], [0.0, 0, -999, 0, 0, 0]]
    )
    sense.given = firm(3), wrench
    sense.estimate(at(3), weight)
    expected = [[0.0, 0.0, -150.0, 0.0, 0.0, 0.0], [80.0, -80.0, 40.0, 15.0, -15.0, 15.0], [0.0, 0, -400.0, 0, 0, 0]]
    np.testing.assert_allclose(5.0 * sense.wrench, expected)


@pytest.mark.parametrize(
    "silent",
    [
        {"forces": firm(1, 29.0)},  # no firm stance
        {"forces": firm(1) * (np.arange(4) == 3)[:, None]},  # stance on one foot
        {"forces": firm(1, 300.0)},  # an impact
        {"gravity": (0.0, -0.21, -0.97)},  # rolled by more than 0.2 rad
        {"gravity": (0.21, 0.0, -0.97)},
    ],
)
def test_a_robot_that_does_not_stand_firmly_tells_nothing_and_the_other_does(silent: dict[str, Any]) -> None:
    forces = np.concatenate((firm(1), silent.get("forces", firm(1))))
    sense, gravity = felt(), [(0.0, 0.0, -1.0), silent.get("gravity", (0.0, 0.0, -1.0))]
    sense.given = forces, np.full((2, 6), 10.0)
    sense.estimate(at(projected_gravity=gravity), np.zeros((2, 6)))
    np.testing.assert_allclose(sense.wrench[0], 2.0)
    np.testing.assert_array_equal(sense.wrench[1], 0.0)
    assert sense._sample_count.tolist() == [1.0, 0.0]


def slid(ratios: list[float], speed: float = 0.5, up: float = 80.0, looks: int = 3, **fields: float) -> np.ndarray:
    """Return the friction estimates, (2,), after `looks` updates; both start at 0.65.

    Feet of the second robot slide, each with its ratio of horizontal to vertical force.
    """
    sense = ContactEstimator(SIMPLE_QUAD, MpcParameters(friction=0.65, **{"grip_memory": 1e6} | fields), 0.01)
    sense.reset(2)
    forces, velocity = np.tile([0.0, 0.0, up], (2, 4, 1)), np.zeros((2, 4, 3))
    for foot, ratio in enumerate(ratios):
        forces[1, foot, :2], velocity[1, foot, :2] = (-0.6 * ratio * up, 0.8 * ratio * up), (0.6 * speed, -0.8 * speed)
    for _ in range(looks):
        sense._estimate_friction(forces, velocity)
    return sense.friction_estimate


@pytest.mark.parametrize(
    ("ratios", "expected"),
    [
        ([0.1], 0.65 - 0.3 * (0.65 - 0.07)),  # 0.7 of the ratio, approached by 0.3 in each update
        ([0.1, 0.4], 0.65 - 0.3 * (0.65 - 0.28)),  # the larger ratio of two feet counts
        ([0.01], 0.65 - 0.3 * (0.65 - 0.05)),  # the minimum friction estimate
        ([1.2], 0.65),  # a larger ratio than the estimate has no effect
    ],
)
def test_what_is_relied_on_is_0_7_of_what_a_slip_shows(ratios: list[float], expected: float) -> None:
    np.testing.assert_allclose(slid(ratios), [0.65, expected], atol=1e-6)


def test_a_foot_slides_at_its_third_look_where_it_is_pressed_and_fast() -> None:
    np.testing.assert_allclose(slid([0.1], looks=2), 0.65)
    np.testing.assert_allclose(slid([0.1], speed=0.24), 0.65)
    np.testing.assert_allclose(slid([0.1], up=30.0), 0.65)  # twice the touch force
    assert slid([0.1], up=30.1)[1] < 0.5


def test_a_slip_is_forgotten_in_the_stated_time() -> None:
    """The estimate recovers 1 / 100 of its deficit in 10 ms, with a time constant of 1 s."""
    expected = 0.476 + 0.01 * (0.65 - 0.476)
    np.testing.assert_allclose(slid([0.1], grip_memory=1.0), [0.65, expected], atol=1e-6)


def test_accelerations_are_those_of_a_rigid_body_about_its_centre_of_mass() -> None:
    """The accelerations of robots of 14.2 and 28.4 kg are force / mass and (moment - centre × force) / inertia."""
    now = at(projected_gravity=[(0.0, 0.0, -1.0), (0.0, -np.sin(0.5), -np.cos(0.5))])
    bodies = now.bodies._replace(
        mass=np.array([14.2, 28.4]),
        com_position=np.array([[0.1, 0.0, -0.2], [0.0, 0.0, 0.0]]),
        rotational_inertia=np.stack((np.diag([1.0, 2.0, 4.0]), np.diag([2.0, 2.0, 2.0]))),
    )
    wrench = np.array([[28.4, 14.2, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 56.8, 0.0, 3.0, 0.0]])
    found = wrench_to_acceleration(bodies, now.rotation, wrench)
    # (0.1, 0, -0.2) × (28.4, 14.2, 0) = (2.84, -5.68, 1.42)
    np.testing.assert_allclose(found[0], [2.0, 1.0, 0.0, (1.0 - 2.84) / 1.0, 5.68 / 2.0, -1.42 / 4.0], atol=1e-6)
    # The second robot is rolled by 0.5 rad: its y axis points up by sin 0.5.
    np.testing.assert_allclose(found[1], [0.0, 0.0, 2.0, 0.0, 1.5 * np.cos(0.5), 1.5 * np.sin(0.5)], atol=1e-6)


def test_a_load_presses_with_its_weight_and_its_arm_in_the_trunk_s_axes() -> None:
    """The payload is 10 kg, 0.1 m to the left and 0.2 m above a trunk rolled by 0.3 rad.

    Its weight acts along (0, -sin, -cos) of 0.3 rad.
    """
    rotation = at(1, projected_gravity=(0.0, -np.sin(0.3), -np.cos(0.3))).rotation
    found = PointLoad(np.array([10.0]), np.array([[0.0, 0.1, 0.2]])).gravity_wrench(rotation)
    moment = 98.1 * (-0.1 * np.cos(0.3) + 0.2 * np.sin(0.3))
    np.testing.assert_allclose(found, [[0.0, 0.0, -98.1, moment, 0.0, 0.0]], atol=1e-4)
    assert not PointLoad(np.zeros(2), np.ones((2, 3))).gravity_wrench(np.stack([np.eye(3)] * 2)).any()


def test_a_load_is_taken_to_be_on_the_trunk() -> None:
    """A load of 98.1 N with moments of 50 N·m would be half a metre away from the trunk."""
    wrench = np.array([[0.0, 0.0, -98.1, -50.0, 50.0, 0.0], [0.0, 0.0, -98.1, 9.81, -4.905, 0.0]])
    np.testing.assert_allclose(estimate_load(wrench, 0.15).position, [[0.25, 0.25, 0.15], [-0.05, -0.1, 0.15]])


def following(velocity: tuple[float, float], command: tuple[float, float, float], turning: float = 0.0) -> MotionState:
    now = at(linear_velocity=(*velocity, 0.0), angular_velocity=(0.0, 0.0, turning))
    return now._replace(command=np.array([command, (0.0, 0.0, 0.0)]))


def test_the_way_lost_since_a_command_was_given_is_made_up_for() -> None:
    """The velocity is short by 0.5 and 0.2 m/s, and 0.4 rad/s, for 10 ms each; a new command resets its own robot."""
    odometer = PositionFeedback(0.6, 0.01)
    odometer.reset(2)
    now = following((0.5, -0.2), (1.0, 0.0, 0.4))
    np.testing.assert_allclose(odometer.with_position_feedback(now, 2.0).command[0], now.command[0])
    for looks in (1, 2, 3):
        found = odometer.with_position_feedback(now, 2.0).command[0]
        np.testing.assert_allclose(
            found, np.array([1.0, 0.0, 0.4]) + 0.02 * looks * np.array([0.5, 0.2, 0.4]), atol=1e-6
        )
    behind = odometer.position_error[1].copy()
    np.testing.assert_allclose(behind, [-0.02, 0.008, 0.0], atol=1e-6)  # the robot is commanded to stand, and is moved
    other = now._replace(command=np.array([(1.0, 0.1, 0.4), (0.0, 0.0, 0.0)]))
    np.testing.assert_allclose(odometer.with_position_feedback(other, 2.0).command[0], [1.0, 0.1, 0.4])
    np.testing.assert_allclose(odometer.position_error[1], behind * 5.0 / 4.0, atol=1e-6)


def test_no_more_than_the_farthest_way_is_made_up_for_and_no_faster_than_the_fastest_return() -> None:
    """0.6 m at 2 / s would add 1.2 m/s; the sum is limited to 1.2 m/s, or to a larger command (1.5 m/s)."""
    for command, expected in (((1.0, 0.0, 0.0), 1.2), ((1.5, 0.0, 0.0), 1.5), ((0.3, 0.0, 0.0), 1.2)):
        odometer = PositionFeedback(0.6, 0.01, 1.2)
        odometer.reset(2)
        now = following((-0.5, 0.0), command, -1.0)
        for _ in range(200):
            found = odometer.with_position_feedback(now, 2.0).command[0]
        np.testing.assert_allclose(found[:2], [expected, 0.0], atol=1e-6)
        np.testing.assert_allclose(found[2], 1.2, atol=1e-6)  # 0.6 rad at 2 / s; the yaw rate has no limit


class Noted:
    """Servos that give no torque and store the requested arguments."""

    stiffness = np.full(12, 300.0)

    def torque(self, targets: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        self.asked = targets, angle, speed
        return np.zeros_like(angle)


def looks_at(
    sense: ContactEstimator, *rows: dict[str, Any], away: Any = False
) -> tuple[MotionState, np.ndarray, np.ndarray]:
    """Return the last of the given motions of one robot, with its contact forces and the remaining wrench."""
    sense.reset(1)
    for each in rows:
        now = at(1, **each)
        forces, wrench = sense._solve_contact_forces(now, away)
    return now, forces, wrench


EARLIER, LATER = (
    {"joint_position": 0.0, "joint_velocity": 0.0, "previous_action": 0.1, "linear_velocity": (0.5, 0.0, 0.0)},
    {"joint_position": 0.02, "joint_velocity": 6.0, "previous_action": 0.3, "linear_velocity": (0.5, 0.2, 0.0)},
)
"""Observations 10 ms apart."""


@pytest.mark.parametrize(
    ("encoders", "targets", "angle", "speed"),
    [
        # Mean of the cubic: half of the distance minus a twelfth of 10 ms times the velocity change; distance by time.
        (False, 0.3, 0.01 - 0.01 / 12.0 * 6.0, 2.0),
        # Differences of encoders are means over a period, centred between two periods.
        (True, 0.2, 0.0 + 0.01 / 12.0 * 6.0, 3.0),
    ],
)
def test_servos_are_asked_for_their_torque_over_the_last_control_period(
    encoders: bool, targets: float, angle: float, speed: float
) -> None:
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01, encoders=encoders)
    sense.foot_forces.servos = servos = Noted()  # type: ignore[assignment]
    looks_at(sense, EARLIER, LATER)
    np.testing.assert_allclose(servos.asked[0][0] - SIMPLE_QUAD.home_pose, targets, atol=1e-6)
    np.testing.assert_allclose(servos.asked[1][0] - SIMPLE_QUAD.home_pose, angle, atol=1e-6)
    np.testing.assert_allclose(servos.asked[2][0], speed, atol=1e-6)
    looks_at(sense, LATER)  # the first update sees no change
    np.testing.assert_allclose(servos.asked[0][0] - SIMPLE_QUAD.home_pose, 0.3, atol=1e-6)
    np.testing.assert_allclose(servos.asked[2][0], 6.0 if encoders else 0.0, atol=1e-6)


@pytest.mark.parametrize("encoders", [False, True])
def test_forces_and_wrench_are_what_the_motion_needed_less_what_the_servos_gave(encoders: bool) -> None:
    """The forces and the wrench satisfy M v̇ + h = τ + Jᵀ f + w.

    The rows of each leg hold Jᵀ f of its foot, the rows of the trunk the wrench and the contact forces. With encoders,
    the result is the mean over two periods. A negative normal force is set to zero.
    """
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01, encoders=encoders)
    sense.foot_forces.servos = Noted()  # type: ignore[assignment]
    before, last = {"linear_velocity": (0.1, -0.1, 0.3)}, {"linear_velocity": (0.3, 0.0, -0.6), "joint_velocity": 0.5}
    now, forces, wrench = looks_at(sense, {}, before, last)
    change = np.zeros(18)
    if encoders:
        change[:3], change[6:] = (0.15, 0.0, -0.3), 0.5  # the trunk over both periods
    else:
        change[:3], change[6:] = (0.2, 0.1, -0.9), 0.5
    needed = now.bodies.inertia[0] @ (change / 0.01) + now.bodies.bias_force[0]
    legs = now.bodies.leg_jacobians[0]
    raw = np.array([np.linalg.lstsq(legs[leg].T, needed[6:].reshape(4, 3)[leg], rcond=None)[0] for leg in range(4)])
    explaining = raw if encoders else np.where(raw[:, 2:] < 0.0, 0.0, raw)
    by_feet = np.einsum("lxk,lx->k", now.bodies.jacobians[0, ..., :6], explaining)
    np.testing.assert_allclose(wrench[0], needed[:6] - by_feet, rtol=0.03, atol=0.5)
    shown = np.where(sense.in_contact[0][:, None], raw, 0.0) if encoders else explaining
    np.testing.assert_allclose(forces[0], shown, rtol=0.03, atol=0.5)
    assert raw[:, 2].min() < -1.0  # some normal forces would be negative


def test_a_robot_that_begins_again_has_not_changed_its_motion_at_its_first_look() -> None:
    """Two robots were thrown up; only the robot without a reset has slowed down from 2 m/s in 10 ms."""
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01)
    sense.reset(2)
    first = sense._solve_contact_forces(at(), False)[1].copy()
    sense._solve_contact_forces(at(linear_velocity=(0.0, 0.0, 2.0)), False)
    sense.reset_where(np.array([False, True]))
    found = sense._solve_contact_forces(at(), False)[1]
    np.testing.assert_allclose(found[1], first[1], atol=1e-6)
    assert np.abs(found[0] - first[0]).max() > 100.0


def test_a_foot_in_mid_swing_touches_nothing_whatever_it_bears() -> None:
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01)
    pressing = {"previous_action": np.tile([0.0, -0.3, 0.3], 4)}
    _, forces, _ = looks_at(sense, pressing)
    assert (forces[0, :, 2] > 2.0 * P.touch_force).all()
    assert sense.in_contact.all()
    _, same, _ = looks_at(sense, pressing, away=np.array([[True, False, False, True]]))
    assert sense.in_contact[0].tolist() == [False, True, True, False]
    np.testing.assert_array_equal(same, forces)


def test_a_foot_in_the_air_has_to_press_harder_to_be_taken_to_stand_on_noisy_joints() -> None:
    """The threshold rises by 0.03 N per N·m/rad of 300: 9 N more than the 15 N of a standing foot."""
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01, encoders=True)
    sense.reset(1)
    now = at(1, previous_action=np.tile([0.0, -0.3, 0.3], 4))
    forces, _ = sense._solve_contact_forces(now, False)
    pressed = float(forces[0, 0, 2])
    for least, touching in (
        (pressed - 8.0, (True, False)),
        (pressed - 10.0, (True, True)),
        (pressed + 1.0, (False, False)),
    ):
        sense._parameters = MpcParameters(touch_force=least)
        for stood, expected in zip((True, False), touching, strict=True):
            sense.in_contact = np.full((1, 4), stood)
            sense._solve_contact_forces(now, False)
            assert bool(sense.in_contact[0, 0]) is expected


def test_what_encoders_show_at_zero_is_learnt_of_feet_in_the_air_and_no_more_than_a_look_tells() -> None:
    """Each update learns 0.01 / 1.01 of the offset, missing torque by stiffness: 0.03 rad for -60 N·m.

    The last leg stands, and its offset is not learnt.
    """
    sense = ContactEstimator(SIMPLE_QUAD, P, 0.01, encoders=True)
    sense.reset(1)
    asked = np.concatenate(([0.2, 0.2, 0.2], np.zeros(6), [0.0, -0.3, 0.3]))
    now = at(1, previous_action=asked)
    sense._solve_contact_forces(now, np.array([[True, True, True, False]]))
    assert sense.in_contact[0].tolist() == [False, False, False, True]
    missing = (now.bodies.bias_force[0, 6:] - 300.0 * asked) / 300.0
    np.testing.assert_allclose(sense.encoder_offsets[0, :3], -0.03 * 0.01 / 1.01, atol=1e-9)
    np.testing.assert_allclose(sense.encoder_offsets[0, 3:9], missing[3:9] * 0.01 / 1.01, atol=1e-6)
    assert (np.abs(missing[3:9]) < 0.03).all()
    assert not sense.encoder_offsets[0, 9:].any()
    shown, joints = sense.remove_encoder_offsets(reading(1, joint_position=0.1)), OBSERVATION["joint_position"]
    np.testing.assert_allclose(shown[0, joints], 0.1 - sense.encoder_offsets[0], atol=1e-6)
    assert ContactEstimator(SIMPLE_QUAD, P, 0.01).remove_encoder_offsets(shown) is shown
