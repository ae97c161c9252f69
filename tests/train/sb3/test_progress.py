"""Progress of a run: the remaining time, with a simulated clock, and the line of statistics."""

import math
from dataclasses import replace

import pytest

from train.config import PpoConfig, TrainConfig, ValidationConfig
from train.sb3.progress import ProgressEstimator, RecentIntervals, summary

PPO = PpoConfig(envs=10, rollout_steps=10, hold=2)
CONFIG = TrainConfig(steps=1000, mixture=(("flat", 1.0), ("push", 1.0)), ppo=PPO, validation=ValidationConfig(300))


class Run:
    """Run with rollouts of 100 steps that last 4 s."""

    def __init__(self, config: TrainConfig = CONFIG, done: int = 0, validated: int = 0) -> None:
        self.now, self.steps = 50.0, done
        self.pace = ProgressEstimator(config, done, validated, lambda: self.now)

    def roll_out(self, rollouts: int) -> None:
        self.steps, self.now = self.steps + 100 * rollouts, self.now + 4.0 * rollouts

    def validate(self, seconds: float) -> None:
        with self.pace.validation(self.steps):
            self.now += seconds

    @property
    def left(self) -> float:
        return self.pace.remaining_time(self.steps)


def test_time_left_counts_the_validations_to_come() -> None:
    """Validations are at 300, 600, 900 steps and at the end."""
    run = Run()
    run.roll_out(3)
    run.validate(30.0)
    assert run.pace.rate(run.steps) == pytest.approx(25.0)  # without the validation time
    assert run.left == pytest.approx(7 * 4.0 + 3 * 30.0)
    run.roll_out(6)
    assert run.left == pytest.approx(1 * 4.0 + 3 * 30.0)  # the validation at 600 is late and comes now
    run.validate(10.0)
    assert run.left == pytest.approx(1 * 4.0 + 1 * 20.0)
    run.roll_out(1)
    assert run.left == pytest.approx(20.0)


def test_before_the_first_validation_its_control_steps_are_taken_to_last_as_long_as_those_of_training() -> None:
    """A rollout has 20 control steps of 0.1 s on each of two scenarios; a validation has 1000 on each of two."""
    run = Run()
    run.roll_out(1)
    assert run.left == pytest.approx(9 * 4.0 + 4 * 2 * 1000 * 0.1)


@pytest.mark.parametrize(("interval", "validations"), [(0, 1), (10_000, 1), (100, 10), (250, 4), (1, 10)])
def test_validations_come_after_whole_rollouts_and_at_the_end(interval: int, validations: int) -> None:
    run = Run(replace(CONFIG, validation=ValidationConfig(interval)))
    run.roll_out(1)
    assert run.left == pytest.approx(9 * 4.0 + validations * 200.0)


def test_a_run_that_is_continued_counts_what_this_session_does() -> None:
    run = Run(done=500, validated=300)
    run.now += 60.0  # repeated actions
    run.pace.restart()
    run.roll_out(1)
    run.validate(7.0)
    assert run.left == pytest.approx(4 * 4.0 + 2 * 7.0)  # validations at 900 and at the end
    assert math.isfinite(ProgressEstimator(CONFIG).remaining_time(0))


def counted(episodes=0, falls=0.0, returned=0.0, tracked=math.nan):
    """Return statistics with fixed errors and reward."""
    means = {"velocity_error": 0.12, "yaw_rate_error": 0.3, "reward_rate": 1.25, "recently_tracked": tracked}
    return {**means, "episodes": episodes, "return": returned, "falls": falls}


ERRORS = "velocity error 0.120 m/s  yaw-rate error 0.300 rad/s"


@pytest.mark.parametrize(
    ("statistics", "said"),
    [
        (counted(), f"reward   1.25/s  no command interval ended  {ERRORS}  no episode ended"),
        (
            counted(160, 0.05, 10.0, 0.625),
            f"reward   1.25/s  63% of command intervals tracked  {ERRORS}  8 of 160 episodes fell",
        ),
        (
            counted(160, 0.05, 10.0, 0.625) | {"success": 0.5},
            f"50% succeeded in validation  reward   1.25/s  63% of command intervals tracked  {ERRORS}  "
            "8 of 160 episodes fell",
        ),
    ],
)
def test_falls_are_counted_among_the_episodes_that_ended(statistics, said) -> None:
    """In the first rollouts few episodes end, mostly by a fall, because walking robots continue."""
    assert summary(statistics) == said


def test_the_line_says_the_same_whatever_the_returns_of_the_episodes_that_happen_to_end() -> None:
    """Returns rise and fall with the number of robots that started together."""
    assert summary(counted(100, returned=1.0)) == summary(counted(100, returned=9.0))


def test_tracked_intervals_are_those_of_the_last_rollouts() -> None:
    recent = RecentIntervals(2)
    assert math.isnan(recent.update(0, math.nan))
    assert recent.update(4, 0.25) == 0.25
    assert recent.update(0, math.nan) == 0.25  # no interval ended
    assert recent.update(12, 0.5) == 0.5  # the oldest 4 intervals are dropped
    assert recent.update(4, 1.0) == 10 / 16
