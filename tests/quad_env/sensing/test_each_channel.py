"""Bias, noise, range, resolution, rate and delay of each sensor by hand, for some robots of a batch at a time."""

from dataclasses import replace

import numpy as np
import pytest

from quad_env import SENSORS, Encoders, FootContact, Imu, JointTorque, Scenario, SensorSuite
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.sensing.sensor_models import BLOCK, Channel, Noise, SensorModels

WIDTHS = {"gyro": 3, "accelerometer": 3, "joint_position": 12, "foot_contact": 4, "joint_torque": 12}
SIZE = sum(WIDTHS.values())
IDEAL, PLAIN = SENSORS["ideal"], Scenario("made")
ALL = np.arange(4)


def instruments(
    suite: SensorSuite, seeds: tuple[int, ...] = (1, 2, 3, 4), scenario: Scenario = PLAIN
) -> tuple[SensorModels, list[EpisodeSample]]:
    """Return the sensors of four robots at the start of the episodes of some seeds, 100 Hz."""
    found = SensorModels(SIMPLE_QUAD, suite, 4, 100.0)
    episodes = [EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, 0.01) for seed in seeds]
    found.reset(ALL, episodes)
    return found, episodes


def measured(values: np.ndarray) -> dict[str, np.ndarray]:
    """Split rows, (k, 34), by sensor."""
    return dict(zip(WIDTHS, np.split(values, np.cumsum([*WIDTHS.values()])[:-1], axis=1), strict=True))


def read(of: SensorModels, step: int, rows: np.ndarray = ALL) -> np.ndarray:
    """Return the sensor readings of some robots, (k, 34)."""
    clock = np.full(len(rows), step)
    return np.concatenate([of.channels[name].value(clock, rows) for name in WIDTHS], axis=1)


def numbered(step: int, rows: int = 4) -> np.ndarray:
    """Return values that encode the step and the entry; they are so large that every foot stands from step 11 on."""
    return step + 0.01 * np.arange(SIZE) + np.zeros((rows, 1))


def test_each_sensor_is_sampled_and_seen_by_its_own_rate_and_delay() -> None:
    """The periods and delays are 2 and 2, 4 and 1, 1 and 3, 5 and 6, in control steps of 10 ms."""
    suite = SensorSuite(
        replace(IDEAL.imu, rate=50.0, delay=0.02),
        replace(IDEAL.encoders, rate=25.0, delay=0.01),
        replace(IDEAL.feet, delay=0.03, threshold=11.0),
        replace(IDEAL.torque, rate=20.0, delay=0.055),
    )
    timing = {"gyro": (2, 2), "accelerometer": (2, 2), "joint_position": (4, 1), "foot_contact": (1, 3)}
    timing["joint_torque"] = (5, 6)
    of, _ = instruments(suite)
    assert of.alignment_delay == 3  # delay of motion and contact; a torque may be later
    for step in range(40):
        of.read(measured(numbered(step)), np.full(4, step), ALL)
        shown = measured(read(of, step))
        for name, (period, late) in timing.items():
            sample = max((step - late) // period, 0) * period
            values = measured(numbered(sample))[name]
            expected = values >= 11.0 if name == "foot_contact" else values
            np.testing.assert_array_equal(shown[name], expected, err_msg=f"{name} at {step}")


NOISY = SensorSuite(
    Imu(None, 0.0, 0.1, 0.2, 1e3, 0.3, 0.4, 1e3),
    Encoders(None, 0.0, None, 0.05, 0.06),
    FootContact(None, 0.0, threshold=0.5, noise=0.7),
    JointTorque(None, 0.0, 0.8, 0.9, 1e3),
)
BIAS = np.repeat([0.1, 0.3, 0.06, 0.0, 0.8], [*WIDTHS.values()])
NOISE = np.repeat([0.2, 0.4, 0.05, 0.7, 0.9], [*WIDTHS.values()])


@pytest.mark.parametrize("randomised", [False, True])
def test_each_entry_has_its_own_bias_and_noise_of_its_robot_s_stream(randomised: bool) -> None:
    """The episode's stream first gives a bias of every entry, then the noise step by step; two robots advance alone."""
    scenario = Scenario("made", randomisation=DomainRandomisation()) if randomised else PLAIN
    of, episodes = instruments(NOISY, scenario=scenario)
    moving = np.array([1, 3])
    bias, noise = np.zeros((4, SIZE)), np.zeros((4, BLOCK, SIZE))
    for row, seed in enumerate((1, 2, 3, 4)):
        stream = EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, 0.01).streams.sensors
        bias[row] = BIAS * stream.standard_normal(SIZE)
        noise[row] = NOISE * stream.standard_normal((BLOCK, SIZE), dtype=np.float32)
        if randomised:
            bias[row, 6:18] += episodes[row].randomised.encoder_offset  # type: ignore[union-attr]
    np.testing.assert_allclose(of.bias, bias)
    for step in range(5):
        of.read(measured(np.zeros((2, SIZE))), np.full(2, step), moving)
        expected = bias[moving] + noise[moving, step]
        expected[:, 18:22] = expected[:, 18:22] >= 0.5
        np.testing.assert_allclose(read(of, step, moving), expected, atol=1e-6)
    np.testing.assert_array_equal(read(of, 0, np.array([0, 2])), 0.0)


def test_accelerometers_at_rest_read_gravity_and_their_own_bias() -> None:
    of, _ = instruments(NOISY)
    up = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(of.specific_force_at_rest(up, np.array([1, 3])), 9.81 * up + of.bias[[1, 3], 3:6])


def test_readings_saturate_at_each_sensor_s_range_and_angles_come_in_steps() -> None:
    """The resolution is 2π / 2⁴ = 0.3927 rad: 1.0 is nearest to three steps; a foot stands from its threshold on."""
    suite = SensorSuite(
        replace(IDEAL.imu, gyro_range=2.0, accelerometer_range=30.0),
        replace(IDEAL.encoders, bits=4),
        replace(IDEAL.feet, threshold=12.0),
        replace(IDEAL.torque, range=None),
    )
    of, _ = instruments(suite)
    values = np.zeros((4, SIZE))
    values[:, :6] = 3.0, -3.0, 1.5, 40.0, -40.0, 20.0
    values[:, 6:10] = 1.0, -1.0, 0.19, 0.2
    values[:, 18:22] = 11.9, 12.0, 12.1, 0.0
    values[:, 22:25] = 150.0, -150.0, 99.0
    of.read(measured(values), np.zeros(4, np.int64), ALL)
    shown = read(of, 0)[2]
    np.testing.assert_array_equal(shown[:6], [2.0, -2.0, 1.5, 30.0, -30.0, 20.0])
    np.testing.assert_allclose(shown[6:10], np.array([3.0, -3.0, 0.0, 1.0]) * np.pi / 8.0)
    np.testing.assert_array_equal(shown[18:22], [0.0, 1.0, 1.0, 0.0])
    np.testing.assert_array_equal(shown[22:25], [100.0, -100.0, 99.0])  # the rated torque of the robot


def test_a_sample_is_new_in_the_step_in_which_it_is_first_seen() -> None:
    """Every fourth control step is sampled with a delay of two steps: samples are new at 2, 6 and 10."""
    channel, clock = Channel(1, 1, 25.0, 0.0, 100.0, max_delay_steps=2), np.arange(12)
    assert np.flatnonzero(channel.is_new(clock, 2)).tolist() == [2, 6, 10]
    assert np.flatnonzero(channel.is_new(clock, 0)).tolist() == [0, 4, 8]


def test_a_sample_of_longer_ago_than_the_delay_can_be_asked_for() -> None:
    channel, row = Channel(1, 1, 50.0, 0.01, 100.0, max_delay_steps=5), np.zeros(1, np.intp)
    for step in range(12):
        clock = np.array([step])
        channel.record(np.array([[float(step)]]), clock, row)
        for late in (None, 0, 1, 3, 5):
            number = max((step - (1 if late is None else late)) // 2, 0)
            assert channel.value(clock, row, late) == 2 * number
            assert channel.previous(clock, row, late) == 2 * max(number - 1, 0)


def test_samples_are_taken_of_those_robots_alone_for_which_one_is_due() -> None:
    """Samples are in every fourth control step of each robot's own clock: 3, 4 and 8."""
    channel, rows = Channel(4, 1, 25.0, 0.0, 100.0), np.array([3, 0, 2])
    channel.record(np.array([[1.0], [2.0], [3.0]]), np.zeros(3, np.int64), rows)
    channel.record(np.array([[4.0], [5.0], [6.0]]), np.array([3, 4, 8]), rows)
    assert channel.value(np.array([3, 4, 8]), rows)[:, 0].tolist() == [1.0, 5.0, 6.0]


def test_noise_of_a_robot_that_begins_again_is_of_its_new_stream_from_the_first_step_on() -> None:
    noise, deviation, both = Noise(2, np.ones(3, np.float32)), np.ones(3), np.arange(2)
    for robot in both:
        noise.reset(robot, np.random.default_rng(robot))
    first = [np.random.default_rng(robot).standard_normal((BLOCK, 3), dtype=np.float32) for robot in (0, 1, 9)]
    for step in range(4):
        np.testing.assert_allclose(noise.at(np.full(2, step), both), deviation * [first[0][step], first[1][step]])
    noise.reset(1, np.random.default_rng(9))
    for step in range(3):
        found = noise.at(np.array([4 + step, step]), both)
        np.testing.assert_allclose(found, [first[0][4 + step], first[2][step]])
    np.testing.assert_allclose(noise.at(np.array([3]), np.array([1])), [first[2][3]])
