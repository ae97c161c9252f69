"""A sighted student observes the height scan of its own robot as it will be in use; its teacher the true ground."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from policies.base import Policy
from policies.history import Inputs
from policies.residual import Features, authority_of
from quad_env import OBSERVATION_SIZE, HeightScan
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from quad_env.sensing.height_scan import UNSEEN
from train.distillation import teacher as teachers
from train.distillation.collection import LabelCollector
from train.distillation.config import DistillationConfig
from train.distillation.run import make_robots
from train.distillation.student import StudentNetwork, make_policy, make_pose
from train.distillation.teacher import PrivilegedTeacher

SCAN = HeightScan(ahead=3, behind=2, aside=2, spacing=0.1, noise=0.03, delay=0.03)
GRID = HeightScan(ahead=1, behind=2, aside=1, spacing=0.15)
"""Height scan of the teacher: 12 points, one for each joint target."""
DELAY_STEPS = 3
EPISODE_STEPS = 40
CONFIG = DistillationConfig(
    max_tilt=3.2,
    teacher="mpc_wbc_sighted",
    sighted=True,
    scan=SCAN,
    envs=10,
    max_episode_steps=EPISODE_STEPS,
    mixture=(("rough=0.24", 0.4), ("slope=15", 0.3), ("rough=0.24+scan_lost", 0.3)),
)
SEEN = 7
"""Number of the robots with a scan, which come first."""
SHARE = 0.1
"""Angle per height in the targets of the teacher, rad/m."""


class ScanEcho(Policy):
    """Teacher with targets that encode its height scan: the home pose plus a tenth of the heights."""

    name = "scan_echo"
    height_scan = GRID

    def _act(self, observation: np.ndarray) -> np.ndarray:
        heights = observation[:, OBSERVATION_SIZE:]
        return self.robot.home_pose.astype(np.float32) + np.float32(SHARE) * heights


class Record(NamedTuple):
    """Scans of n robots in T control steps, m."""

    student: np.ndarray
    """Scan in the inputs of the student, relative to the trunk's centre, (T, n, 30)."""
    teacher: np.ndarray
    """Scan that the labels of the teacher encode, (T, n, 12)."""
    true: np.ndarray
    """True heights on the grid of the student, (T, n, 30)."""
    true_for_teacher: np.ndarray
    """True heights on the grid of the teacher, (T, n, 12)."""
    observed: np.ndarray
    """Scan in the observation of the environment, (T, n, 30)."""


@contextmanager
def collecting(config: DistillationConfig) -> Iterator[LabelCollector]:
    """Give a collector of labels of `ScanEcho`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(teachers, "make_teacher", lambda config, profile=False: ScanEcho(robot=SIMPLE_QUAD))
        robots = make_robots(config, SIMPLE_QUAD)
        features = Features(make_pose(SIMPLE_QUAD, config.height_scan), Inputs())
        teacher = PrivilegedTeacher(config, robots)
        collector = LabelCollector(config, robots, teacher, features, authority_of(SIMPLE_QUAD, 0.9, 2.0))
    collector.start_segment(seeds_of(config), np.random.default_rng(0))
    yield collector
    robots.close()


def seeds_of(config: DistillationConfig) -> list[int]:
    return [int(seed) for seed in episode_seeds("training", 0, config.envs)]


def record(config: DistillationConfig, steps: int = EPISODE_STEPS) -> Record:
    """Return the scans of student and teacher while the robots move at random."""
    random = np.random.default_rng(0)
    rows = []
    with collecting(config) as each:
        own = slice(OBSERVATION_SIZE, OBSERVATION_SIZE + len(config.scan.points))
        for _ in range(steps):
            inputs, corrections = each._label()
            student = inputs[:, own] / each._features._table.scale[own] - SIMPLE_QUAD.home_height
            true, true_for_teacher = (true_scans(each._robots, scan) for scan in (config.scan, GRID))
            rows.append(
                (student, corrections * each._authority / SHARE, true, true_for_teacher, each._observation[:, own])
            )
            each._step(each._home + 0.3 * random.standard_normal((config.envs, 12)).astype(np.float32))
    return Record(*map(np.array, zip(*rows, strict=True)))


def true_scans(robots: Any, scan: HeightScan) -> np.ndarray:
    """Return the heights of the ground at the points of a scan around each robot, relative to its trunk, (n, p), m."""
    return np.concatenate([true_scan(batch, scan) for batch in robots.batches])


def true_scan(batch: Any, scan: HeightScan) -> np.ndarray:
    qpos = batch.simulation.qpos
    w, x, y, z = qpos[:, 3:7].T
    heading = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))[:, None]
    ahead, left = scan.points.T
    x_world = qpos[:, 0:1] + np.cos(heading) * ahead - np.sin(heading) * left
    y_world = qpos[:, 1:2] + np.sin(heading) * ahead + np.cos(heading) * left
    heights: np.ndarray = batch.scenario.terrain.height(x_world, y_world) - qpos[:, 2:3]
    return heights


def test_the_teacher_observes_the_true_ground_now() -> None:
    found = record(CONFIG)
    np.testing.assert_allclose(found.teacher[:, :SEEN], found.true_for_teacher[:, :SEEN], atol=1e-5)
    assert np.ptp(found.true_for_teacher[:, :SEEN], axis=2).max() > 0.05, "level ground shows no fault"


def test_the_student_observes_the_scan_of_its_robot_with_its_delay() -> None:
    found = record(replace(CONFIG, scan=replace(SCAN, noise=0.0)))
    true = found.true[:, :SEEN]
    np.testing.assert_allclose(found.student[DELAY_STEPS:, :SEEN], true[:-DELAY_STEPS], atol=2e-6)
    np.testing.assert_allclose(found.student[:DELAY_STEPS, :SEEN], np.repeat(true[:1], DELAY_STEPS, 0), atol=2e-6)
    assert np.abs(np.diff(true, axis=0)).max() > 0.005, "a scan of another step would be the same"
    assert np.abs(true[:, 1:] - true[:, :-1]).max() > 0.05, "a scan of another robot would be the same"


def test_the_student_observes_the_scan_with_its_noise() -> None:
    found = record(CONFIG)
    noise = found.student[DELAY_STEPS:, :SEEN] - found.true[:-DELAY_STEPS, :SEEN]
    assert noise.std() == pytest.approx(SCAN.noise, rel=0.03)
    assert abs(noise.mean()) < 0.002
    flat = noise.transpose(1, 0, 2).reshape(SEEN, -1)
    assert np.abs(np.corrcoef(flat) - np.eye(SEEN)).max() < 0.1
    np.testing.assert_allclose(found.student[:, :SEEN], found.observed[:, :SEEN], atol=2e-6)


def test_a_lost_scan_is_level_ground_for_the_student_and_no_ground_for_its_teacher() -> None:
    found = record(CONFIG, steps=10)
    with collecting(CONFIG) as each:
        inputs, _ = each._label()
        own = slice(OBSERVATION_SIZE, OBSERVATION_SIZE + len(SCAN.points))
        np.testing.assert_array_equal(inputs[SEEN:, own], 0.0)
        assert (inputs[:SEEN, own] != 0.0).all()
    np.testing.assert_array_equal(found.observed[:, SEEN:], UNSEEN)
    np.testing.assert_allclose(found.teacher[:, SEEN:], UNSEEN, atol=1e-5)
    assert found.teacher[:, :SEEN].min() > -1.0


def test_dropouts_hide_the_same_ground_from_student_and_teacher() -> None:
    config = replace(CONFIG, envs=40, mixture=(("rough=0.24+scan_dropouts", 1.0),), max_episode_steps=400)
    found = record(config, steps=250)
    lost, lost_for_teacher = found.observed == UNSEEN, np.isclose(found.teacher, UNSEEN, atol=1e-4)
    np.testing.assert_array_equal(lost.all(axis=2), lost_for_teacher.all(axis=2))
    np.testing.assert_array_equal(lost.any(axis=2), lost_for_teacher.any(axis=2))
    partial = lost.any(axis=2) & ~lost.all(axis=2)
    assert 0.05 < partial.mean() < lost.any(axis=2).mean() < 0.9
    np.testing.assert_allclose(found.student[lost], -SIMPLE_QUAD.home_height, atol=1e-6)
    np.testing.assert_allclose(found.teacher[~lost_for_teacher], found.true_for_teacher[~lost_for_teacher], atol=1e-5)


def test_a_robot_that_begins_again_sees_the_ground_of_its_new_start() -> None:
    found = record(replace(CONFIG, scan=replace(SCAN, noise=0.0)), steps=EPISODE_STEPS + 10)
    begun = found.student[EPISODE_STEPS : EPISODE_STEPS + DELAY_STEPS, :SEEN]
    np.testing.assert_allclose(begun, np.repeat(found.true[EPISODE_STEPS : EPISODE_STEPS + 1, :SEEN], 3, 0), atol=2e-6)
    assert np.abs(found.true[EPISODE_STEPS, :SEEN] - found.true[EPISODE_STEPS - 1, :SEEN]).max() > 0.05


def test_the_policy_acts_in_evaluation_as_the_student_in_training() -> None:
    config = replace(CONFIG, round_steps=60)
    with collecting(config) as each:
        student = StudentNetwork([each._features.width, 16, 12], 1)
        student.standardise(each.collect(student, 1.0).inputs.reshape(-1, each._features.width))
        each.start_segment(seeds_of(config), np.random.default_rng(0))
        driven = []
        true_step = each._step
        each._step = lambda actions: driven.append(actions) or true_step(actions)
        each.collect(student, 0.0)
    policy = make_policy(config, SIMPLE_QUAD, student.to_network(), Inputs())
    assert (policy.name, policy.height_scan) == ("sighted", SCAN)
    policy.reset(config.envs)
    robots = make_robots(config, SIMPLE_QUAD)
    observation, _ = robots.reset(seed=seeds_of(config))
    for actions in driven:
        limited = np.clip(actions, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
        np.testing.assert_allclose(policy.act(observation), limited, atol=2e-4)
        observation, _, terminated, truncated, _ = robots.step(actions)
        if (finished := terminated | truncated).any():
            observation, _ = robots.reset(options={"reset_mask": finished})
            policy.reset_where(finished)
    robots.close()
