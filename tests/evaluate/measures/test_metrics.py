"""Metrics, compared with values computed by hand; a time step of 0.1 s keeps the numbers simple."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluate.measures import metrics
from evaluate.measures.episodes import Episodes, empty_signal
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful

DT = 0.1
STEPS = 100
SETTLING = 10
COMMAND_STEPS = 50


def episodes(velocity, command=(1.0, 0.0, 0.5), fall_step=STEPS, power=71.0) -> Episodes:
    """Return one episode with a heading velocity that is constant or given per step."""
    speed, work = (
        empty_signal(SIMPLE_QUAD, "joint_velocity", STEPS, 1),
        empty_signal(SIMPLE_QUAD, "positive_work", STEPS, 1),
    )
    speed[..., :4], work[..., 0] = (10.0, 11.0, 11.0, -11.0), power * DT  # three of twelve joints are too fast
    return uneventful(
        SIMPLE_QUAD,
        STEPS,
        dt=DT,
        command_steps=COMMAND_STEPS,
        command=np.broadcast_to(np.asarray(command, np.float32), (STEPS, 3))[:, None].copy(),
        heading_velocity=np.broadcast_to(np.asarray(velocity, np.float32), (STEPS, 3))[:, None].copy(),
        joint_velocity=speed,
        positive_work=work,
        fall_step=np.array([fall_step]),
        fall_reason=np.array([None if fall_step == STEPS else "tilt"], dtype=object),
        weight=142.0,
    )


def measure(*args, **kwargs) -> metrics.Measures:
    return metrics.measure(episodes(*args, **kwargs))


def test_a_steady_robot_is_billed_its_velocity_error() -> None:
    # 3-4-5: the robot is 0.3 m/s too slow and drifts 0.4 m/s to the left.
    measures = measure((0.7, 0.4, 0.2))
    assert measures.velocity_error == pytest.approx([0.5])
    assert measures.velocity_error_upright == pytest.approx([0.5])
    assert measures.mean_velocity_error == pytest.approx([0.5])
    assert measures.yaw_rate_error == pytest.approx([0.3])
    assert not measures.fell[0]
    assert np.isnan(measures.fall_time[0])


def test_the_first_second_is_not_judged_and_a_step_costs_at_most_the_cap() -> None:
    velocity = np.tile((1.0, 0.0, 0.5), (STEPS, 1))
    velocity[:SETTLING] = 50.0
    velocity[SETTLING : SETTLING + 9] = (11.0, 0.0, 50.0)  # errors of 10 m/s and 49.5 rad/s in 9 of 90 steps
    measures = measure(velocity)
    assert measures.velocity_error == pytest.approx([0.1 * 2.0])
    assert measures.yaw_rate_error == pytest.approx([0.1 * 3.0])


def test_every_step_from_the_fall_to_the_time_limit_costs_the_cap() -> None:
    # 90 judged steps: 27 upright with an error of 0.5 m/s and 0.3 rad/s, then 63 with the maximum error.
    measures = measure((0.7, 0.4, 0.2), fall_step=SETTLING + 27)
    assert measures.velocity_error == pytest.approx([0.3 * 0.5 + 0.7 * 2.0])
    assert measures.yaw_rate_error == pytest.approx([0.3 * 0.3 + 0.7 * 3.0])
    assert measures.velocity_error_upright == pytest.approx([0.5])
    # The windows are steps 10..49 and 60..99: the robot is upright in 27 of these 80 steps.
    assert measures.mean_velocity_error == pytest.approx([(27 * 0.5 + 53 * 2.0) / 80])
    assert measures.fell[0]
    assert measures.fall_time == pytest.approx([3.8])  # step 37 ends after 3.8 s
    assert measure((1.0, 0.0, 0.0), fall_step=STEPS - 1).fell[0]


def test_readings_after_a_fall_do_not_count_whatever_they_are() -> None:
    velocity = np.tile((0.7, 0.4, 0.2), (STEPS, 1))
    velocity[40:] = np.nan
    with_nan = measure(velocity, fall_step=40)
    without = measure((0.7, 0.4, 0.2), fall_step=40)
    for name in ("velocity_error", "yaw_rate_error", "mean_velocity_error", "energy", "distance", "overspeed"):
        assert getattr(with_nan, name) == pytest.approx(getattr(without, name), nan_ok=False)


def test_swaying_within_a_stride_costs_velocity_error_but_no_mean_velocity_error() -> None:
    velocity = np.tile((1.0, 0.0, 0.5), (STEPS, 1))
    velocity[::2, 1], velocity[1::2, 1] = 0.3, -0.3
    measures = measure(velocity)
    assert measures.velocity_error == pytest.approx([0.3])
    assert measures.mean_velocity_error == pytest.approx([0.0], abs=1e-12)


def test_each_command_interval_has_its_own_mean_after_its_first_second() -> None:
    command = np.tile((1.0, 0.0, 0.0), (STEPS, 1))
    command[COMMAND_STEPS:] = (-1.0, 0.0, 0.0)
    velocity = command * 0.8
    velocity[COMMAND_STEPS : COMMAND_STEPS + SETTLING] = (1.0, 0.0, 0.0)  # still in its turn
    measures = measure(velocity, command)
    assert measures.mean_velocity_error == pytest.approx([0.2])
    np.testing.assert_allclose(measures.commands[0, :, 0], (1.0, -1.0))
    np.testing.assert_allclose(measures.mean_velocities[0, :, 0], (0.8, -0.8))


def test_an_interval_has_a_command_if_begun_and_a_mean_velocity_if_ended_upright() -> None:
    measures = measure((0.7, 0.4, 0.2), fall_step=COMMAND_STEPS + 1)
    assert np.isfinite(measures.commands).all()
    assert np.isfinite(measures.mean_velocities[0, 0]).all()
    assert np.isnan(measures.mean_velocities[0, 1]).all()
    commands = measure((0.7, 0.4, 0.2), fall_step=COMMAND_STEPS).commands[0]
    np.testing.assert_array_equal(commands[0], (1.0, 0.0, 0.5))
    assert np.isnan(commands[1]).all()


@pytest.mark.parametrize(("turns", "outcome"), [(slice(75, None), "stalled"), (slice(75), "off_command")])
def test_an_interval_weighs_as_long_as_it_is(turns, outcome) -> None:
    """The command is a turn for 6.5 s and for 1.5 s; the robot turns in one of the intervals."""
    velocity = np.zeros((STEPS, 3))
    velocity[turns, 2] = 0.5
    record = replace(episodes(velocity, (0.0, 0.0, 0.5)), command_steps=75)
    assert metrics.measure(record).outcome == [outcome]


@pytest.mark.parametrize(("begin", "outcome"), [(STEPS - 20, "stalled"), (STEPS - 4, "fell")])
def test_a_stop_counts_only_if_it_was_begun_before_the_fall(begin, outcome) -> None:
    stopped = (np.arange(STEPS) >= begin)[:, None]
    record = replace(episodes((0.0, 0.0, 0.0), fall_step=STEPS - 5), stopped=stopped)
    assert metrics.outcome(record) == [outcome]


def test_falling_within_the_first_second_leaves_nothing_upright() -> None:
    measures = measure((1.0, 0.0, 0.5), fall_step=3)
    assert measures.velocity_error == pytest.approx([2.0])
    assert measures.yaw_rate_error == pytest.approx([3.0])
    assert measures.mean_velocity_error == pytest.approx([2.0])
    assert np.isnan(measures.velocity_error_upright[0])
    assert np.isnan(measures.cost_of_transport[0])


@pytest.mark.parametrize(("fall", "seconds"), [(STEPS, 9.0), (SETTLING + 40, 4.0)])
def test_cost_of_transport_is_energy_over_weight_times_distance_up_to_a_fall(fall, seconds) -> None:
    """The energy is 71 W times the time, the weight 142 N, and the speed 0.5 m/s."""
    measures = measure((0.3, 0.4, 0.0), fall_step=fall)
    assert measures.energy == pytest.approx([71.0 * seconds])
    assert measures.distance == pytest.approx([0.5 * seconds])
    assert measures.cost_of_transport == pytest.approx([1.0])


def test_stepping_in_place_has_no_cost_of_transport() -> None:
    velocity = np.zeros((STEPS, 3))
    velocity[::2, 0], velocity[1::2, 0] = 0.8, -0.8  # a path of 7 m without displacement
    measures = measure(velocity)
    assert measures.distance == pytest.approx([0.0], abs=1e-9)
    assert np.isnan(measures.cost_of_transport[0])


@settings(max_examples=30)
@given(
    velocities=st.lists(st.tuples(st.floats(-1.4, 1.4), st.floats(-1, 1), st.floats(-5, 5)), min_size=5, max_size=5),
    falls=st.tuples(st.integers(0, STEPS), st.integers(0, STEPS)),
)
def test_falling_earlier_never_lowers_an_error(velocities, falls) -> None:
    # The mean errors are below the cap, as for a robot with at most 3 m/s.
    velocity = np.repeat(velocities, STEPS // 5, axis=0)
    early, late = (measure(velocity, (0.0, 0.0, 0.0), fall_step=fall) for fall in sorted(falls))
    for name in ("velocity_error", "yaw_rate_error", "mean_velocity_error"):
        assert getattr(early, name)[0] >= getattr(late, name)[0] - 1e-12


def test_a_summary_is_the_plain_mean_over_episodes() -> None:
    """One robot falls at once; the other does not move at a command of 1 m/s and 0.5 rad/s."""
    command, falls = np.full((STEPS, 2, 3), (1.0, 0.0, 0.5), np.float32), np.array([SETTLING, STEPS])
    summary = metrics.summarise(
        uneventful(SIMPLE_QUAD, STEPS, 2, dt=DT, command_steps=COMMAND_STEPS, command=command, fall_step=falls)
    )
    assert (summary["fall_rate"], summary["diverged_rate"], summary["success_rate"]) == (0.5, 0.0, 0.0)
    assert summary["velocity_error"] == pytest.approx((2.0 + 1.0) / 2)
    assert summary["yaw_rate_error"] == pytest.approx((3.0 + 0.5) / 2)
    assert summary["energy"] == 0.0
    assert np.isnan(summary["cost_of_transport"])  # no robot moves
