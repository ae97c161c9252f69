"""A sample is held until the next one, visible after the given delay, and has its sampling time; noise is white."""

import numpy as np
import pytest

from quad_env.sensing.sensor_models import BLOCK, Channel, Noise, delay_to_steps


def seen(rate: float, delay: float, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return values, previous values and time stamps of a sensor of the control step, 100 Hz, by hand, (steps,)."""
    channel, rows, out = Channel(1, 1, rate, delay, 100.0), np.zeros(1, np.intp), []
    for step in range(steps):
        clock = np.array([step])
        channel.record(np.array([[float(step)]]), clock, rows)
        out.append((channel.value(clock, rows)[0, 0], channel.previous(clock, rows)[0, 0], channel.time(clock)[0]))
    value, before, time = np.array(out).T
    return value, before, time


@pytest.mark.parametrize("rate", [100.0, 50.0, 25.0, 20.0, 4.0])
@pytest.mark.parametrize("delay", [0.0, 0.01, 0.03, 0.1])
def test_it_is_the_newest_sample_that_has_arrived(rate: float, delay: float) -> None:
    value, before, time = seen(rate, delay, 200)
    period, late = round(100 / rate), round(100 * delay)
    for step in range(200):
        arrived = [taken for taken in range(0, step + 1, period) if taken + late <= step] or [0]
        assert value[step] == arrived[-1]
        assert before[step] == max(arrived[-1] - period, 0)
        assert time[step] == arrived[-1] / 100


def test_what_arrives_between_two_control_steps_is_seen_at_the_next() -> None:
    assert [delay_to_steps(delay, 100.0) for delay in (0.0, 0.001, 0.01, 0.011, 0.07)] == [0, 1, 1, 2, 7]


def test_a_robot_that_starts_anew_forgets_what_it_saw() -> None:
    channel, rows = Channel(2, 1, 100.0, 0.02, 100.0), np.arange(2)
    for step in range(5):
        channel.record(np.full((2, 1), step + 1.0), np.full(2, step), rows)
    channel.record(np.array([[9.0]]), np.zeros(1, np.int64), rows[1:])
    assert channel.value(np.array([4, 0]), rows)[:, 0].tolist() == [3.0, 9.0]
    assert channel.previous(np.array([4, 0]), rows)[:, 0].tolist() == [2.0, 9.0]


def test_noise_goes_on_from_block_to_block_of_each_robot_s_own_stream() -> None:
    noise, deviation, robots = Noise(2, np.array([1.0, 3.0], np.float32)), np.array([1.0, 3.0]), np.arange(2)
    for robot in robots:
        noise.reset(robot, np.random.default_rng(robot))
    found = np.array([noise.at(np.full(2, step), robots) for step in range(2 * BLOCK + 3)])
    for robot in robots:
        drawn = np.random.default_rng(robot).standard_normal((3 * BLOCK, 2), dtype=np.float32)
        np.testing.assert_allclose(found[:, robot], deviation * drawn[: len(found)], rtol=1e-6)
