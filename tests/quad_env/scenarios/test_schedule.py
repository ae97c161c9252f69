"""Schedule of each robot by hand: episode, command and pushes."""

import numpy as np
import pytest

from quad_env.config import CommandRanges
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Kicks, Pushes
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.schedule import EpisodeSchedule

DT = 0.01
PUSHED = Scenario(
    "made", pushes=Pushes(count=2, duration=0.05, window=(0.0, 0.4)), commands=CommandRanges(interval=0.1)
)
ALL = np.arange(3)


def schedule(seeds: list[int | None] | int = [4, 5, 6], scenario: Scenario = PUSHED) -> EpisodeSchedule:  # noqa: B006
    found = EpisodeSchedule(SIMPLE_QUAD, scenario, 3, DT)
    found.reseed(seeds, np.ones(3, np.bool_))  # type: ignore[arg-type]
    return found


def episode(seed: int, number: int) -> EpisodeSample:
    return EpisodeSample(SIMPLE_QUAD, PUSHED, seed, number, DT)


def test_each_robot_has_the_episodes_of_its_own_seed_one_after_the_other() -> None:
    """Robot 1 is in its third episode when the others start their second one, and then gets another seed."""
    found = schedule()
    numbers = {0: 0, 1: 0, 2: 0}
    for robots in ([0, 1, 2], [1], [0, 1, 2]):
        begun = found.reset(np.array(robots), None)
        for robot, its in zip(robots, begun, strict=True):
            expected = episode(4 + robot, numbers[robot])
            np.testing.assert_array_equal(its.start, expected.start)
            np.testing.assert_array_equal(found.command[robot], expected.next_command())
            np.testing.assert_array_equal(found.pushes.first_step[robot], expected.pushes.first_step)
            np.testing.assert_array_equal(found.pushes.force[robot], expected.pushes.force)
            numbers[robot] += 1
    found.reseed([9, 9, None], np.array([False, True, True]))
    begun = found.reset(ALL, None)
    for its, (seed, number) in zip(begun, ((4, 2), (9, 0), (6, 2)), strict=True):
        np.testing.assert_array_equal(its.start, episode(seed, number).start)
    with pytest.raises(ValueError, match="seeds"):
        found.reseed([1, 2], np.ones(3, np.bool_))


def test_a_new_command_comes_where_one_has_been_followed_for_its_time() -> None:
    """A new command comes every ten control steps of a robot's own clock, from its own stream."""
    found, drawn = schedule(), [episode(4 + robot, 0) for robot in range(3)]
    found.reset(ALL, None)
    commands = [each.next_command() for each in drawn]
    found.step_count[:] = 10, 9, 20
    found.resample_commands(slice(None))
    for robot in (0, 2):
        commands[robot] = drawn[robot].next_command()
    np.testing.assert_array_equal(found.command, commands)
    found.step_count[:] = 20, 10, 30
    found.resample_commands(np.array([1]))
    commands[1] = drawn[1].next_command()
    np.testing.assert_array_equal(found.command, commands)


def test_the_clock_and_the_commands_of_one_robot_are_those_of_a_batch_of_one() -> None:
    alone = EpisodeSchedule(SIMPLE_QUAD, PUSHED, 1, DT)
    batch = EpisodeSchedule(SIMPLE_QUAD, PUSHED, 1, DT)
    rows = np.arange(1)
    commands = []
    for found in (alone, batch):
        found.reseed([4], np.ones(1, np.bool_))
        found.reset(rows, None)
    for _ in range(25):
        alone.count_step(None)
        alone.resample_commands(None)
        batch.count_step(rows)
        batch.resample_commands(rows)
        assert alone.step_count == batch.step_count
        np.testing.assert_array_equal(alone.command, batch.command)
        commands.append(tuple(alone.command[0]))
    assert len(set(commands)) == 3


def test_a_command_that_is_given_holds_to_the_end_of_the_episode() -> None:
    """Each robot has its own command; a robot that is reset without a command draws one."""
    found, held = schedule(), np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    found.reset(ALL, held)
    np.testing.assert_array_equal(found.command, held)
    found.step_count[:] = 10
    found.resample_commands(slice(None))
    np.testing.assert_array_equal(found.command, held)
    found.reset(np.array([1]), None)
    np.testing.assert_array_equal(found.command[1], episode(5, 1).next_command())
    np.testing.assert_array_equal(found.command[[0, 2]], held[[0, 2]])
    found.fix_commands(held[::-1])
    found.step_count[:] = 20
    found.resample_commands(slice(None))
    np.testing.assert_array_equal(found.command, held[::-1])


def test_pushes_act_for_their_time_and_those_by_hand_on_top_of_them() -> None:
    """Planned pushes follow the clock of each robot; a manual push starts in its own step and ends with the episode."""
    found = schedule()
    found.reset(ALL, None)
    plans = [episode(4 + robot, 0).pushes for robot in range(3)]

    def planned(clock: np.ndarray) -> np.ndarray:
        total = np.zeros((3, 2))
        for robot, plan in enumerate(plans):
            for first, force in zip(plan.first_step, plan.force, strict=True):
                if first <= clock[robot] < first + 5:
                    total[robot] += force
        return total

    seen = 0
    for step in range(45):
        found.step_count[:] = step, step + 3, step + 11
        force = found.push_force()
        assert force is not None
        np.testing.assert_allclose(force, planned(found.step_count))
        seen += int(np.abs(force).any(axis=1).sum())
    assert seen > 20
    found.step_count[:] = [plan.first_step[0] for plan in plans]
    found.apply_push(np.ones((3, 2)), 1)
    np.testing.assert_allclose(found.push_force(), planned(found.step_count) + 1.0)
    found.step_count[:] = 100, 200, 300
    by_hand = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    found.apply_push(by_hand, 2)
    for _ in range(2):
        np.testing.assert_allclose(found.push_force(), by_hand)
        found.step_count += 1
    assert not found.push_force().any()  # type: ignore[union-attr]
    found.apply_push(by_hand, 5)
    found.reset(np.array([1]), None)
    found.step_count[0], found.step_count[2] = 102, 302
    force = found.push_force()
    assert force is not None
    np.testing.assert_allclose(force[[0, 2]], by_hand[[0, 2]])
    plans[1] = episode(5, 1).pushes
    np.testing.assert_allclose(force[1], planned(np.array([999, 0, 999]))[1])


def test_where_nothing_pushes_there_is_no_force_before_the_first_push_by_hand() -> None:
    found = schedule(scenario=Scenario("made"))
    found.reset(ALL, None)
    assert found.push_force() is None
    found.apply_push(np.ones((3, 2)), 1)
    np.testing.assert_array_equal(found.push_force(), np.ones((3, 2)))


def test_random_intervals_are_exponential_and_of_the_mean_that_is_named() -> None:
    """Kolmogorov-Smirnov distance of 4000 intervals from the exponential distribution, below its 0.1 % limit."""
    commands = CommandRanges(interval=0.5, random_intervals=True)
    drawn = EpisodeSample(SIMPLE_QUAD, Scenario("made", commands=commands), 4, 0, DT)
    intervals = np.sort([drawn.next_interval(DT) for _ in range(4000)]) * DT
    assert intervals.min() >= DT
    expected = 1.0 - np.exp(-(intervals - DT / 2) / 0.5)  # rounded to control steps
    assert np.abs(expected - np.arange(1, 4001) / 4000).max() < 1.95 / np.sqrt(4000) + DT / 0.5


def test_commands_come_at_the_drawn_times() -> None:
    commands = CommandRanges(interval=0.05, random_intervals=True)
    found = schedule(scenario=Scenario("made", commands=commands))
    twin = EpisodeSample(SIMPLE_QUAD, Scenario("made", commands=commands), 4, 0, DT)
    found.reset(ALL, None)
    expected, due = twin.next_command(), twin.next_interval(DT)
    changes = 0
    for step in range(1, 200):
        found.step_count[:] = step
        found.resample_commands(slice(None))
        if step == due:
            expected = twin.next_command(expected)
            due += twin.next_interval(DT)
            changes += 1
        np.testing.assert_array_equal(found.command[0], expected)
    assert changes > 10


def test_components_are_switched_off_and_kept_as_often_as_named() -> None:
    commands = CommandRanges(zero_fraction=0.0, on_probability=(0.9, 0.25, 0.5), keep_probability=0.5)
    drawn = EpisodeSample(SIMPLE_QUAD, Scenario("made", commands=commands), 4, 0, DT)
    first = np.array([drawn.next_command() for _ in range(4000)])
    np.testing.assert_allclose((first != 0.0).mean(axis=0), (0.9, 0.25, 0.5), atol=0.03)
    assert np.abs(first).max(axis=0) == pytest.approx((1.5, 0.8, 1.2), rel=0.02)
    present = np.array((0.123, 0.456, 0.789))
    later = np.array([drawn.next_command(present) for _ in range(4000)])
    np.testing.assert_allclose((later == present).mean(axis=0), 0.5, atol=0.03)
    np.testing.assert_allclose((later == 0.0).mean(axis=0), 0.5 * np.array((0.1, 0.75, 0.5)), atol=0.03)


def test_commands_by_default_take_no_more_numbers_from_their_stream() -> None:
    drawn, plain = episode(4, 0), episode(4, 0)
    commands = [drawn.next_command() for _ in range(5)]
    assert {plain.next_interval(DT) for _ in range(5)} == {10}
    np.testing.assert_array_equal([plain.next_command(np.ones(3)) for _ in range(5)], commands)


def test_kicks_are_of_each_strength_up_to_the_largest_and_after_the_pushes() -> None:
    """The velocity change of a kick is force · time / mass, uniform up to 2 m/s."""
    kicks = Kicks(speed=2.0, duration=(0.05, 0.2), interval=(1.0, 3.0), count=2000)
    made = EpisodeSample(SIMPLE_QUAD, Scenario("made", pushes=PUSHED.pushes, kicks=kicks), 4, 0, DT).pushes
    plain = episode(4, 0).pushes
    np.testing.assert_array_equal(made.force[:2], plain.force)
    np.testing.assert_array_equal(made.first_step[:2], plain.first_step)
    steps = np.asarray(made.steps)
    assert steps[:2].tolist() == [plain.steps] * 2
    speed = np.hypot(*made.force[2:].T) * steps[2:] * DT / SIMPLE_QUAD.mass
    assert speed.max() <= 2.0
    assert np.quantile(speed, (0.25, 0.5, 0.75)) == pytest.approx((0.5, 1.0, 1.5), abs=0.1)
    gaps = np.diff(made.first_step[2:]) * DT
    assert gaps.min() >= 1.0 - DT
    assert gaps.max() <= 3.0 + DT
    assert set(steps[2:].tolist()) <= set(range(5, 21))
    assert len(set(steps[2:].tolist())) == 16
    begin = int(made.first_step[2])
    np.testing.assert_array_equal(made.force_at(np.array(begin)), made.force[2])
    assert not made.force_at(np.array(begin + steps[2])).any()
