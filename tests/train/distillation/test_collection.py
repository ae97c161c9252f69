"""Labels of a distillation belong to the state, the robot and the episode of the student's observation."""

from dataclasses import replace

import numpy as np
import pytest

from policies.base import Policy
from policies.history import Inputs
from policies.residual import Features, authority_of
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from quad_env.task.observations import observation_table
from train.distillation import teacher as teachers
from train.distillation.collection import DriverSchedule, LabelCollector, _precedes
from train.distillation.config import DistillationConfig
from train.distillation.run import make_robots
from train.distillation.student import StudentNetwork, make_policy, make_pose
from train.distillation.teacher import PrivilegedTeacher

CONFIG = DistillationConfig(
    teacher="trot",
    envs=6,
    round_steps=60,
    max_episode_steps=40,
    max_tilt=3.2,
    first_difficulty=1.0,
    mixture=(("flat", 1.0),),
)


class Echo(Policy):
    """Teacher with targets that encode its observation: the home pose plus a tenth of the
    joint angles, and the step count.
    """

    name = "echo"
    steps: np.ndarray

    def reset(self, num_envs=1, seed=None):
        super().reset(num_envs, seed)
        self.steps = np.zeros(num_envs)

    def _reset_rows(self, mask):
        super()._reset_rows(mask)
        self.steps[mask] = 0.0

    def _act(self, observation):
        self.steps += 1.0
        targets = self.robot.home_pose.astype(np.float32) + 0.1 * observation[:, 9:21]
        targets[:, 0] = self.robot.home_pose[0] + 0.001 * self.steps
        return targets


def make_collector(config):
    """Return a collector with the teacher `Echo`, a student of eight units, and the authority, (12,), rad."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(teachers, "make_teacher", lambda config, profile=False: Echo(robot=SIMPLE_QUAD))
        robots = make_robots(config, SIMPLE_QUAD)
        features = Features(make_pose(SIMPLE_QUAD), Inputs())
        authority = authority_of(SIMPLE_QUAD, 0.9, 2.0)
        collector = LabelCollector(config, robots, PrivilegedTeacher(config, robots), features, authority)
    seeds = [int(seed) for seed in episode_seeds("training", 0, config.envs)]
    collector.start_segment(seeds, np.random.default_rng(0))
    return collector, StudentNetwork([features.width, 8, 12], 0), authority


def shown_angles(block, authority):
    """Return a tenth of the joint angles of the teacher's observation, (T, n, 11), rad, without the first joint.

    The first joint encodes the number of steps.
    """
    return (block.corrections * authority)[:, :, 1:]


def input_angles(block):
    """Return the joint angles relative to the home pose in the student's inputs, (T, n, 11), rad."""
    scale = observation_table(SIMPLE_QUAD).scale[10:21]
    return block.inputs[:, :, 10:21] / scale


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_label_is_of_the_state_that_the_student_observes(share):
    each, student, authority = make_collector(CONFIG)
    block = each.collect(student, share)
    assert np.abs(input_angles(block)).max() > 0.05
    np.testing.assert_allclose(shown_angles(block, authority), 0.1 * input_angles(block), atol=1e-5)


def test_the_teacher_observes_the_present_state_though_the_student_does_not():
    delayed = replace(CONFIG, mixture=(("latency=0.04", 1.0),))
    each, student, authority = make_collector(delayed)
    block = each.collect(student, 0.0)
    steps = 4
    shown, observed = shown_angles(block, authority)[:30], 0.1 * input_angles(block)[:30]
    np.testing.assert_allclose(shown[:-steps], observed[steps:], atol=1e-5)
    assert np.abs(shown - observed).max() > 0.005


def test_the_teacher_is_reset_with_its_robot():
    each, student, authority = make_collector(CONFIG)
    block = each.collect(student, 0.0)
    steps = np.round((block.corrections * authority)[:, :, 0] / 0.001)
    began = np.flatnonzero(steps[:, 0] == 1)
    assert began.tolist() == [0, 40]
    np.testing.assert_array_equal(steps[:40, 0], np.arange(1, 41))


def test_a_model_based_teacher_has_the_gait_clock_of_the_student():
    """Pushes raise the velocity errors, so that the clocks of the robots hurry."""
    config = replace(
        CONFIG, teacher="mpc_wbc", envs=3, round_steps=120, mixture=(("push=60", 1.0),), max_episode_steps=90
    )
    teacher = teachers.make_teacher(config)
    inputs = teachers.student_inputs(config, teacher)
    assert (inputs.clock, inputs.clock_gain) == (teacher.frequency, teacher.parameters.frequency_gain)
    robots = make_robots(config, teacher.robot)
    group = PrivilegedTeacher(config, robots)
    features = Features(make_pose(teacher.robot), inputs)
    each = LabelCollector(config, robots, group, features, authority_of(teacher.robot, 0.9, 2.0))
    each.start_segment([1, 2, 3], np.random.default_rng(0))
    hurried = 0.0
    for _ in range(120):
        _, corrections = each._label()
        controller = group._groups[0][0]
        np.testing.assert_allclose(np.exp(1j * controller.phase), np.exp(1j * features.clock_phase), atol=1e-9)
        np.testing.assert_array_equal(controller._frequencies, features.clock_frequency)
        hurried = max(hurried, float(features.clock_increase.max()))
        each._step(each._home + each._authority * corrections)
    assert hurried > 0.3


@pytest.mark.parametrize("position_error", ["teacher", "none"])
@pytest.mark.parametrize("clock", ["teacher", "constant", "none"])
def test_clock_and_position_error_of_the_student_are_choices(clock, position_error):
    config = replace(CONFIG, teacher="mpc_wbc", clock=clock, position_error=position_error)
    teacher = teachers.make_teacher(config)
    inputs = teachers.student_inputs(config, teacher)
    assert inputs.clock == (0.0 if clock == "none" else teacher.frequency)
    assert (inputs.clock_gain > 0.0) == (clock == "teacher")
    assert (inputs.position_error > 0.0) == (position_error == "teacher")
    assert (inputs.lags, inputs.averages) == (config.inputs.lags, config.inputs.averages)


def test_a_teacher_walks_by_its_own_clock_if_the_student_has_none():
    config = replace(CONFIG, teacher="mpc_wbc", clock="none", envs=3, mixture=(("flat", 1.0),))
    teacher = teachers.make_teacher(config)
    robots = make_robots(config, teacher.robot)
    group = PrivilegedTeacher(config, robots)
    features = Features(make_pose(teacher.robot), teachers.student_inputs(config, teacher))
    each = LabelCollector(config, robots, group, features, authority_of(teacher.robot, 0.9, 2.0))
    each.start_segment([1, 2, 3], np.random.default_rng(0))
    phases = []
    for _ in range(12):
        _, corrections = each._label()
        phases.append(group._groups[0][0].phase.copy())
        each._step(each._home + each._authority * corrections)
    frequency = np.angle(np.exp(1j * np.diff(phases, axis=0))) / (2.0 * np.pi * robots.dt)
    assert frequency.min() > teacher.frequency - 1e-9
    assert frequency.max() < teacher.frequency + teacher.parameters.most_faster


def test_who_drives_is_drawn_by_the_teachers_share():
    drivers = DriverSchedule(CONFIG, 1000, 0.01, np.random.default_rng(0))
    mean = []
    for _ in range(400):
        drivers.step(0.3)
        mean.append(drivers.teacher_drives.mean())
    assert np.mean(mean) == pytest.approx(0.3, abs=0.03)
    assert drivers.is_noisy.mean() == pytest.approx(0.5, abs=0.06)


def test_labels_shortly_before_a_fall_are_dropped():
    fell = np.zeros((8, 2), bool)
    fell[5, 0] = True
    assert _precedes(fell, 3)[:, 0].tolist() == [False, False, False, True, True, True, False, False]
    assert not _precedes(fell, 3)[:, 1].any()


def test_an_episode_ends_when_the_trunk_tilts_too_far():
    config = replace(CONFIG, max_tilt=0.1, fall_margin=0.02)
    each, student, authority = make_collector(config)
    block = each.collect(student, 0.0)
    steps = np.round((block.corrections * authority)[:, :, 0] / 0.001)
    upward_gravity = block.inputs[:, :, 2] / observation_table(SIMPLE_QUAD).scale[2]
    assert (-upward_gravity >= np.cos(0.1) - 1e-6).all()
    tipped = (steps[1:] == 1) & (steps[:-1] < 40)
    assert tipped.any()
    # The two labels before each such end are dropped. The end of the round hides whether its last step is such an end.
    dropped = tipped[:-1] | tipped[1:]
    np.testing.assert_array_equal(~block.is_valid[:58], dropped)


TERM_INPUTS = Inputs(terms=("angular_velocity", "joint_position", "command"), history=3, clock=2.5)


@pytest.mark.parametrize(
    ("hold", "inputs"),
    [(hold, inputs) for hold in (1, 3) for inputs in (Inputs((0.02,), (0.3,), 2.5), TERM_INPUTS)],
)
def test_the_students_policy_does_in_evaluation_as_in_training(hold, inputs, monkeypatch):
    """Inputs, clock, history, standardisation and authority equal those of the collection."""
    config = replace(CONFIG, hold=hold)
    each, _, _ = make_collector(config)
    each._features = Features(make_pose(SIMPLE_QUAD), inputs, hold)
    student = StudentNetwork([each._features.width, 16, 12], 1)
    seeds = [int(seed) for seed in episode_seeds("training", 0, CONFIG.envs)]
    each.start_segment(seeds, np.random.default_rng(0))
    # The states are those of the student, since larger ones exceed the limit of the activations of a bundle.
    student.standardise(each.collect(student, 0.0).inputs.reshape(-1, each._features.width))
    each.start_segment(seeds, np.random.default_rng(0))
    driven = []
    monkeypatch.setattr(each, "_step", lambda actions, step=each._step: driven.append(actions) or step(actions))
    each.collect(student, 0.0)
    policy = make_policy(config, SIMPLE_QUAD, student.to_network(), inputs)
    policy.reset(CONFIG.envs)
    robots = make_robots(CONFIG, SIMPLE_QUAD)
    observation, _ = robots.reset(seed=seeds)
    for step in range(60):
        actions = policy.act(observation)
        limited = np.clip(driven[step], SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
        np.testing.assert_allclose(actions, limited, atol=2e-4)
        observation, _, terminated, truncated, _ = robots.step(driven[step])
        if (finished := terminated | truncated).any():
            observation, _ = robots.reset(options={"reset_mask": finished})
            policy.reset_where(finished)
