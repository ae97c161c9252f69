"""Motion estimates under unknown noise and unknown delays."""

from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest

from evaluate.rollouts.observers import FallRecorder, Step
from evaluate.rollouts.rollout import roll_out
from policies.contact.motion_state import MotionState
from policies.mpc.calibration import CALIBRATION_STEPS
from policies.mpc.policy import MpcWbc
from policies.mpc.reading_noise import NOISE_FLOOR_STD, NoiseEstimator
from policies.mpc.readings import GROUPS, SENSED
from quad_env import OBSERVATION
from quad_env.seeding import episode_seeds
from tests.policies.readings import reading
from train.curriculum import with_terrain_seed

SEEDS, STEPS = episode_seeds("search", 0, 2), 150
NOISE = {"noise=0.2": (0.05, 0.2, 0.1, 0.01, 1.5), "noise=0.8": (0.2, 0.8, 0.4, 0.04, 6.0)}


@dataclass
class Watched(MpcWbc):
    """The policy with a record of the results of its observer in every control step."""

    read: list[MotionState] = field(default_factory=list)
    ahead: list[MotionState] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        read, ahead = self.observer.read, self.observer.predict
        self.observer.read = lambda *arguments: self._kept(self.read, read(*arguments))  # type: ignore[method-assign]
        self.observer.predict = lambda *arguments: self._kept(self.ahead, ahead(*arguments))  # type: ignore[method-assign]

    @staticmethod
    def _kept(motions: list[MotionState], motion: MotionState) -> MotionState:
        motions.append(motion)
        return motion


@cache
def walked(scenario: str) -> Watched:
    """Return the policy after a walk of 1.5 s without a fall."""
    policy, falls = Watched(), FallRecorder(len(SEEDS), STEPS)
    roll_out(
        policy, with_terrain_seed(scenario, "search"), SEEDS, lambda step: step.number and falls(step), steps=STEPS
    )
    assert not falls.fell.any()
    return policy


def error(ahead: list[MotionState], read: list[MotionState], late: int, part: str) -> float:
    """Return the RMS difference between predictions and later readings, without the first half second."""
    foreseen, there = (np.array([getattr(each, part) for each in motions]) for motions in (ahead, read))
    return float(np.sqrt(np.mean((foreseen[50:-late] - there[50 + late :]) ** 2)))


@pytest.mark.parametrize(("scenario", "delay"), [("flat", 0), ("latency=0.01", 2), ("latency=0.02", 4)])
def test_delays_show(scenario: str, delay: int) -> None:
    """The estimated delay is the sum of action and reading delay, in control steps."""
    np.testing.assert_array_equal(walked(scenario).observer.delays, delay)


@pytest.mark.parametrize(("scenario", "late"), [("flat", 0), ("latency=0.08", 16)])
def test_a_robot_walks_once_it_knows_its_delay(scenario: str, late: int) -> None:
    """The robot stands and then bends its legs until they move; the delay is then known."""
    policy = MpcWbc()
    roll_out(policy, with_terrain_seed(scenario, "search"), SEEDS, steps=CALIBRATION_STEPS[0] + late + 3)
    np.testing.assert_array_equal(policy.observer.calibrating, False)
    np.testing.assert_array_equal(policy.observer.delays, late)


def test_late_readings_are_carried_on_to_where_the_robot_is_by_then() -> None:
    """The prediction over four control steps is far better than the unchanged reading."""
    policy, late = walked("latency=0.02"), 4
    for part, most in (("velocity", 0.1), ("angular_velocity", 0.5), ("joint_position", 0.02), ("tilt", 0.01)):
        assert error(policy.ahead, policy.read, late, part) < min(
            most, 0.5 * error(policy.read, policy.read, late, part)
        ), part


def test_readings_without_noise_and_delay_are_taken_as_they_are() -> None:
    policy = Watched()
    shown: list[np.ndarray] = []

    def watch(step: Step) -> None:
        shown.append(step.observation.astype(np.float64))

    roll_out(policy, "flat", SEEDS, watch, steps=60)
    for observation, read, ahead in zip(shown, policy.read, policy.ahead, strict=False):
        np.testing.assert_allclose(
            read.generalised_velocity[:, 6:], observation[:, OBSERVATION["joint_velocity"]], atol=1e-12
        )
        np.testing.assert_array_equal(ahead.generalised_velocity, read.generalised_velocity)


@pytest.mark.parametrize("scenario", list(NOISE))
def test_noise_shows(scenario: str) -> None:
    """Variances are estimated in addition to those of a quiet walk, for the scenario's noise on a motion at 2.5 Hz."""
    noise, rng = NoiseEstimator(0.01), np.random.default_rng(0)
    noise.reset(2)
    time = 0.01 * np.arange(400)
    sines = np.sin(2 * np.pi * 2.5 * time[:, None] + np.arange(SENSED.stop))
    sigma = np.repeat(NOISE[scenario], [group.stop - group.start for group in GROUPS])
    for each in sines:
        found = noise.update(np.tile(0.2 * each, (2, 1)) + sigma * rng.standard_normal((2, SENSED.stop)))
    np.testing.assert_allclose(found, np.tile(np.square(NOISE[scenario]) - NOISE_FLOOR_STD**2, (2, 1)), rtol=0.3)


@pytest.mark.parametrize("scenario", ["latency=0.02", "noise=0.8"])
def test_robots_walk_on_late_and_on_noisy_readings(scenario: str) -> None:
    missed = [motion.velocity - motion.command for motion in walked(scenario).read[100:]]
    assert np.hypot(*np.mean(missed, axis=0)[:, :2].T).max() < 0.3


def test_a_restart_forgets_one_robot_alone() -> None:
    policy = deepcopy(walked("latency=0.02"))
    policy.observer.reset_where(np.array([True, False]))
    np.testing.assert_array_equal(policy.observer.delays, (0, 4))
    np.testing.assert_array_equal(policy.observer.sample_count > 0, (False, True))


def test_a_restarted_robot_doubts_its_readings_as_a_new_one_does() -> None:
    """The same noisy readings give the same motions, to the bit, after a reset as in a new policy."""
    rng, (old, new) = (
        np.random.default_rng(1),
        (MpcWbc(joint_delay_steps=1).observer, MpcWbc(joint_delay_steps=1).observer),
    )
    noisy = reading(40, joint_position=0.05 * rng.standard_normal((40, 12))).astype(np.float32)
    noisy[:, OBSERVATION["linear_velocity"]] = 0.3 * rng.standard_normal((40, 3))
    for row in noisy:
        old.read(row[None], np.zeros((1, 6)))
    old.reset_where(np.array([True]))
    for row in noisy[:15]:
        restarted, fresh = (each.read(row[None], np.zeros((1, 6))) for each in (old, new))
    np.testing.assert_array_equal(restarted.generalised_velocity, fresh.generalised_velocity)
    np.testing.assert_array_equal(restarted.joint_position, fresh.joint_position)


def test_targets_are_those_that_were_asked_for_not_its_own() -> None:
    """The observer uses the applied targets, as under a residual policy that shifts them."""
    policy = MpcWbc()
    read = policy.observer.read(reading(1, previous_action=0.1), np.zeros((1, 6)))
    np.testing.assert_allclose(read.targets, policy.robot.home_pose[None] + 0.1, atol=1e-6)
