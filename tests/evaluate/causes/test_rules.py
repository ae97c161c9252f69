"""Each rule of causes by hand, on records with one event."""

from typing import Any

import numpy as np
import pytest

from evaluate.causes import rules
from evaluate.causes.record import EpisodeSignals
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, SteadyForce
from quad_env.scenarios.scenario import Scenario
from tests.evaluate.causes.made import END, RISER, STEPS, TIME_CONSTANT, recorded, signal


def blow(step: int, before: float = 1.0, at: float = 0.4, after: float = 0.0, *, lands: bool = True) -> EpisodeSignals:
    """Return a record in which the swinging front left foot hits a riser in a step.

    The other feet rest at the origin.
    """
    points, velocity = np.zeros((2, END, 4, 4, 3))
    points[:, 0, 3, 0] = 0.73
    velocity[:step, 0, 3, 0], velocity[step, 0, 3, 0], velocity[step + 1 :, 0, 3, 0] = before, at, after
    contact = signal("foot_contact")
    contact[:, 1, 1:] = True
    contact[step:, 1, 0] = lands
    scenario = Scenario("made", terrain=RISER)
    return recorded(scenario, shank=(points, velocity), foot_contact=contact)


def test_a_leg_that_swings_against_a_riser_trips_by_the_speed_that_it_loses() -> None:
    """The speed falls from 1 m/s, the mean of three steps, to 0.2 m/s, of the impact and the next step: 0.8 / 0.5 m/s.

    One step later it falls from 0.8 m/s to 0, two steps later from 0.467 m/s. After three steps of stance, no trip is
    found.
    """
    event, *others = rules.trips(blow(130))
    assert [each.score for each in others] == pytest.approx([1.6, 1.4 / 3.0 / 0.5])
    assert (event.cause, event.step, event.is_instantaneous) == (rules.TRIP, 130, True)
    assert event.score == pytest.approx(1.6)
    assert event.description == "front left foot hits the edge of a step (0.15 m) at 1.0 m/s"


def test_a_leg_trips_only_where_it_touches_after_a_swing_and_within_the_window() -> None:
    assert not list(rules.trips(blow(130, lands=False)))
    assert not list(rules.trips(blow(130, before=0.2, at=0.15)))  # a loss of 0.125 m/s
    seen = {step: [event.step for event in rules.trips(blow(step))] for step in (107, 108, 159, 160)}
    assert seen == {107: [], 108: [110], 159: [159], 160: []}
    for step, seen_there in ((198, [198]), (199, [])):  # the record ends at 199
        record = blow(step)
        vars(record)["window"] = slice(110, END)
        assert [event.step for event in rules.trips(record)] == seen_there
    level = blow(130)
    object.__setattr__(level, "scenario", Scenario("made"))
    assert not list(rules.trips(level))


def pushed(*steps: int, onset: int = 150, **known: Any) -> list[rules.Event]:
    """Return push events of the second robot, 50 N·s each for ten control steps; the first robot has other pushes."""
    impulse = np.tile((30.0, 40.0), (2, len(steps), 1))
    impulse[0] *= 3.0
    of_both = np.array([[149] * len(steps), steps])
    return list(
        rules.pushes(
            recorded(onset=onset, push_step=of_both, push_impulse=impulse, push_steps=10, **known),
        )
    )


def test_a_push_counts_by_how_far_it_moves_the_capture_point() -> None:
    """50 N·s on 14.2 kg give 3.521 m/s, which move the capture point by 0.236 s times that, relative to 0.3 m."""
    (event,) = pushed(140)
    assert event.description == "a push of 50 N·s, 3.5 m/s for its mass"
    assert event.score == pytest.approx(50.0 / 14.2 * TIME_CONSTANT / 0.3, rel=1e-4)
    assert (event.cause, event.step, event.is_instantaneous) == (rules.PUSH, 140, True)


def test_a_push_may_be_the_cause_from_1_2_s_before_the_onset_until_a_push_s_length_after_it() -> None:
    """An anomaly may begin while the push still acts; a push that begins after the anomaly is not its cause."""
    assert [event.step for event in pushed(29, 30, 150, 155, 160, 161)] == [30, 150, 155, 160]
    assert [event.step for event in pushed(198, 199, 200, onset=195)] == [198, 199]  # no push after the fall
    assert not pushed(140, end=STEPS)  # without a fall


@pytest.mark.parametrize(("way", "counts"), [(1.0, True), (0.6, True), (0.4, False), (-1.0, False)])
def test_a_steady_force_counts_where_the_robot_gives_way_to_it(way: float, counts: bool) -> None:
    """60 N are 0.431 of the weight, relative to 0.3; the capture point moves along the force
    at least half of its distance.
    """
    scenario = Scenario("made", force=SteadyForce(60.0))
    record = recorded(scenario)
    along = record.sampled.force / 60.0
    across = np.array([-along[1], along[0]])
    vars(record)["capture_point_offset"] = np.tile(0.2 * (way * along + np.sqrt(1.0 - way * way) * across), (END, 1))
    events = list(rules.pushes(record))
    assert len(events) == counts
    if counts:
        assert events[0].step == 149
        assert events[0].score == pytest.approx(60.0 / (14.2 * 9.81) / 0.3)
        assert not events[0].is_instantaneous


@pytest.mark.parametrize(("friction", "factor"), [(0.25, 1.0), (0.8, 0.5 / 0.8)])
def test_feet_that_stand_and_slide_count_by_their_share_and_the_ground(friction: float, factor: float) -> None:
    """The first foot slides at 0.6 m/s in the last 10 of 50 steps, and the second foot at 0.3 m/s.

    The third foot lands at that time and counts from its second step on; the last foot swings. The share is 10 of 50 +
    50 + 9 steps, relative to 0.55.
    """
    points, velocity = np.zeros((2, END, 4, 4, 3))
    velocity[150:, 0, 3, 1], velocity[150:, 1, 3, 0] = 0.6, 0.3
    velocity[150:151, 2, 3, 0] = 2.0
    contact = signal("foot_contact")
    contact[:, 1, :2] = contact[150:, 1, 2] = True
    scenario = Scenario("made", ground=Ground(friction=friction))
    (event,) = rules.slides(recorded(scenario, shank=(points, velocity), foot_contact=contact))
    assert (event.cause, event.step) == (rules.SLIP, 150)
    assert event.score == pytest.approx(10.0 / 109.0 / 0.55 * factor)
    assert event.description == f"9% of the standing feet slide, at 0.6 m/s, friction {friction:g}"


def test_motors_count_by_the_share_of_time_and_joints_at_their_own_limit() -> None:
    """The right front calf gives its maximum of 40 N·m from step 120 on.

    Its mean over five steps is at 0.95 of the maximum from step 124 on. The share is 36 of 50 steps in one of 12
    joints, relative to 0.1. Another joint gives 40 of its 100 N·m.
    """
    torque, heat = signal("joint_torque"), np.full_like(signal("joule_heat"), np.nan)
    torque[120:, 1, 5], torque[:, 1, 4] = -40.0, 40.0
    limit = tuple(40.0 if joint == 5 else 100.0 for joint in range(12))
    (event,) = rules.motor_saturation(recorded(joint_torque=torque, joule_heat=heat, torque_limit=limit))
    assert (event.cause, event.step) == (rules.MOTOR, 124)
    assert event.score == pytest.approx(36.0 / 50.0 / 12.0 / 0.1)
    assert event.description == "front right calf motor is 72% of the time at its limit, 40 N·m"


def test_motors_with_a_curve_count_at_their_speed_without_load_too() -> None:
    """The speed is 9.6 of 10 rad/s in ten steps; motors without a torque-speed curve may rotate at this speed."""
    speed, unknown = signal("peak_speed"), np.full_like(signal("joule_heat"), np.nan)
    speed[150:, 1, 1] = 9.6
    (event,) = rules.motor_saturation(recorded(peak_speed=speed, speed_limit=10.0))
    assert event.score == pytest.approx(10.0 / 50.0 / 12.0 / 0.1)
    (event,) = rules.motor_saturation(recorded(peak_speed=speed, speed_limit=10.0, joule_heat=unknown))
    assert event.score == 0.0


def test_servos_of_a_bandwidth_count_by_how_far_they_are_behind() -> None:
    """The lag is 0.7 rad in half of the window: 0.35 on average, relative to 0.35."""
    action = signal("action")
    action[135:, 1, 7] = -0.7
    _, event = rules.motor_saturation(recorded(Scenario("made", motors=Motors(bandwidth=5.0)), action=action))
    assert (event.cause, event.step) == (rules.MOTOR, 110)
    assert event.score == pytest.approx(1.0)
    assert event.description == "servos of 5 Hz are 0.35 rad behind"


def test_standing_legs_count_at_a_joint_limit_and_stretched() -> None:
    """One stance leg is at its hip limit in 10 + 10 steps, the other is straight in 10: 30 of 100, relative to 0.7."""
    joints, contact = signal("joint_position"), signal("foot_contact")
    joints[..., 2::3] = -1.2
    joints[140:150, 1, 0], joints[150:, 1, 0] = SIMPLE_QUAD.joint_lower[0], SIMPLE_QUAD.joint_upper[0]
    joints[150:, 1, 5] = 0.0
    joints[:, 1, 8] = 0.0  # a swing leg
    contact[:, 1, :2] = True
    (event,) = rules.limits(recorded(joint_position=joints, foot_contact=contact))
    assert (event.cause, event.step) == (rules.REACH, 140)
    assert event.score == pytest.approx(0.3 / 0.7, rel=1e-6)


def facing(pitch: float) -> np.ndarray:
    quaternion = signal("quaternion")
    quaternion[...] = np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0
    return quaternion


def test_an_estimate_counts_by_the_error_of_tilt_and_velocity_at_the_moment_that_it_is_of() -> None:
    """The readings are 30 ms old: tilt error 0.3 rad, relative to 0.2, and velocity error 0.75 m/s, relative to 0.5.

    The error compares each estimate with the state at its own time.
    """
    scenario = Scenario("made", latency=Latency(action=0.0, observation=0.03))
    observed = signal("observed")
    observed[..., 2] = -1.0
    (event,) = rules.estimation_error(recorded(scenario, quaternion=facing(0.3), observed=observed))
    assert (event.cause, event.step) == (rules.ESTIMATE, 110)
    assert event.score == pytest.approx(1.5, rel=1e-5)
    observed[..., 6:8] = 0.45, 0.6
    (event,) = rules.estimation_error(recorded(scenario, quaternion=facing(0.0), observed=observed))
    assert event.score == pytest.approx(1.5, rel=1e-5)
    rolling = np.zeros((STEPS, 1, 4))
    pitch = 0.05 * np.arange(STEPS)[:, None] % 1.0
    rolling[..., 0], rolling[..., 2] = np.cos(pitch / 2), np.sin(pitch / 2)
    observed[..., :3] = 0.0, 0.0, -1.0
    observed[3:, :, 0], observed[3:, :, 2] = np.sin(pitch[:-3]), -np.cos(pitch[:-3])
    observed[..., 6:9] = 0.0
    turning = np.repeat(rolling, 2, axis=1).astype(np.float32)
    (event,) = rules.estimation_error(recorded(scenario, quaternion=turning, observed=observed))
    assert event.score == pytest.approx(0.0, abs=5e-3)
    observed[..., :3] = 0.0, 0.0, -1.0
    moving, quaternion = signal("heading_velocity"), facing(0.0)
    moving[:, :, 0] = 0.01 * np.arange(STEPS)[:, None]
    observed[..., 6:9] = 0.0
    observed[3:, :, 6] = moving[:-3, :, 0]
    (event,) = rules.estimation_error(
        recorded(scenario, quaternion=quaternion, heading_velocity=moving, observed=observed)
    )
    assert event.score == pytest.approx(0.0, abs=1e-5)


def test_a_delay_counts_both_ways_together() -> None:
    """The sum of 20 and 50 ms is compared with 0.4 of the time constant of falling, 0.236 s."""
    (event,) = rules.delay_or_dropout(recorded(Scenario("made", latency=Latency(action=0.02, observation=0.05))))
    assert event.description == "readings and actions are 70 ms late together"
    assert event.score == pytest.approx(0.07 / TIME_CONSTANT / 0.4, rel=1e-4)


def test_a_servo_without_targets_counts_by_how_far_its_joint_should_have_gone() -> None:
    """The distance from the last received target, 20 ms late, to the farthest lost target is 0.45 rad.

    The score is 0.45 / 0.15.
    """
    lost = Dropouts(count=1, duration=0.3, window=(1.1, 1.5))
    scenario = Scenario("made", dropouts=lost, latency=Latency(action=0.02, observation=0.0))
    record = recorded(scenario)
    ((start,), (joint,)) = record.sampled.dropouts
    assert 110 <= start <= 120
    action = signal("action")
    action[start - 2 :, 1, joint] = 0.3
    action[start + 10, 1, joint] = 0.45
    action[start + 28 :, 1, joint] = 9.0  # arrives after the end
    record = recorded(scenario, action=action, window=slice(110, 160))
    _, event = rules.delay_or_dropout(record)
    assert (event.cause, event.step, event.is_instantaneous) == (rules.SIGNAL, start, True)
    assert event.score == pytest.approx(3.0, rel=1e-5)
    assert " receives no targets for 0.30 s, 0.45 rad off" in event.description
    assert len(list(rules.delay_or_dropout(recorded(scenario, action=action, window=slice(10, 100), onset=90)))) == 1
    assert (
        len(list(rules.delay_or_dropout(recorded(scenario, action=action, window=slice(start + 65, 195), onset=190))))
        == 1
    )
    assert (
        len(list(rules.delay_or_dropout(recorded(scenario, action=action, window=slice(start + 64, 195), onset=190))))
        == 2
    )
