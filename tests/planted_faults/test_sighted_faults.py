"""Faults in the distillation of a sighted student: a scan of another step, robot or quality, or a teacher's on it."""

from typing import Any

import numpy as np
import pytest

from policies.residual import Features
from quad_env import OBSERVATION_SIZE
from quad_env.sensing.height_scan import ScanLoss
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests, one_call_old
from tests.train.distillation import test_sighted
from train.distillation import student
from train.distillation.collection import LabelCollector
from train.training_robots import MultiScenarioVectorEnv


def check_the_teacher_observes_the_true_ground() -> None:
    test_sighted.test_the_teacher_observes_the_true_ground_now()


def check_the_student_observes_the_scan_of_its_robot_with_its_delay() -> None:
    test_sighted.test_the_student_observes_the_scan_of_its_robot_with_its_delay()


def check_the_student_observes_the_scan_with_its_noise() -> None:
    test_sighted.test_the_student_observes_the_scan_with_its_noise()


def check_a_lost_scan_is_level_ground() -> None:
    test_sighted.test_a_lost_scan_is_level_ground_for_the_student_and_no_ground_for_its_teacher()


def check_dropouts_hide_the_same_ground_from_student_and_teacher() -> None:
    test_sighted.test_dropouts_hide_the_same_ground_from_student_and_teacher()


def check_the_policy_acts_as_the_student_in_training() -> None:
    test_sighted.test_the_policy_acts_in_evaluation_as_the_student_in_training()


def _teacher_on_the_students_scan(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: the scan of the teacher has the noise of the student's."""
    true_observation = MultiScenarioVectorEnv.true_observation

    def noisy(robots: Any, *arguments: Any, **options: Any) -> np.ndarray:
        observation: np.ndarray = true_observation(robots, *arguments, **options)
        noise = np.random.default_rng(0).normal(0.0, test_sighted.SCAN.noise, observation.shape)
        observation[:, OBSERVATION_SIZE:] += noise[:, OBSERVATION_SIZE:].astype(np.float32)
        return observation

    patch.setattr(MultiScenarioVectorEnv, "true_observation", noisy)


def _teacher_that_sees_what_the_student_cannot(patch: pytest.MonkeyPatch) -> None:
    true_observation = MultiScenarioVectorEnv.true_observation
    patch.setattr(
        MultiScenarioVectorEnv, "true_observation", lambda robots, scan, with_scan_loss: true_observation(robots, scan)
    )


def _observation(change: Any) -> Plant:
    """Return a fault: the student's scan of the n robots, (n, p), is changed before it reaches the features."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_update = Features.update

        def update(features: Any, observation: np.ndarray, base_action: np.ndarray) -> np.ndarray:
            changed = observation.copy()
            changed[:, OBSERVATION_SIZE:] = change(observation[:, OBSERVATION_SIZE:], features)
            values: np.ndarray = true_update(features, changed, base_action)
            return values

        patch.setattr(Features, "update", update)

    return plant


def _scan_of_the_step_before(scan: np.ndarray, features: Any) -> np.ndarray:
    before: np.ndarray = getattr(features, "scan_before", scan)
    features.scan_before = scan.copy()
    return before


def _true_scan_for_the_student(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: the student observes the true scan without noise and delay."""
    true_label = LabelCollector._label

    def label(collector: Any) -> Any:
        own = collector._observation[:, OBSERVATION_SIZE:]
        true = collector._robots.true_observation(collector._config.scan, with_scan_loss=True)
        own[:] = true[:, OBSERVATION_SIZE:]
        return true_label(collector)

    patch.setattr(LabelCollector, "_label", label)


def _lost_scan_as_deep_ground(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: a lost scan reads ground 2 m below the trunk."""

    def level_scan(features: Any, _: np.ndarray, scaled: np.ndarray) -> None:
        scaled[:, features._own :] += features._level

    patch.setattr(Features, "_level_scan", level_scan)


def _policy_without_its_scan(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: the trained policy asks for no scan."""
    true_make = student.make_policy

    def make_policy(*arguments: Any) -> Any:
        policy = true_make(*arguments)
        policy.height_scan = None
        return policy

    patch.setattr(test_sighted, "make_policy", make_policy)


FAULTS: Faults = {
    "a teacher on the student's noisy scan": (
        _teacher_on_the_students_scan,
        check_the_teacher_observes_the_true_ground,
    ),
    "a teacher whose scan is a step old": (
        one_call_old(MultiScenarioVectorEnv, "true_observation"),
        check_the_teacher_observes_the_true_ground,
    ),
    "a student's scan of the step before": (
        _observation(_scan_of_the_step_before),
        check_the_student_observes_the_scan_of_its_robot_with_its_delay,
    ),
    "a student's scan without its delay": (
        _true_scan_for_the_student,
        check_the_student_observes_the_scan_of_its_robot_with_its_delay,
    ),
    "a student's scan without its noise": (
        _true_scan_for_the_student,
        check_the_student_observes_the_scan_with_its_noise,
    ),
    "scans of two robots exchanged": (
        _observation(lambda scan, _: scan[[1, 0, *range(2, len(scan))]]),
        check_the_student_observes_the_scan_of_its_robot_with_its_delay,
    ),
    "scans of all robots in reverse order": (
        _observation(lambda scan, _: scan[::-1]),
        check_the_student_observes_the_scan_with_its_noise,
    ),
    "a lost scan that is no level ground": (_lost_scan_as_deep_ground, check_a_lost_scan_is_level_ground),
    "a teacher that sees the ground of a lost scan": (
        _teacher_that_sees_what_the_student_cannot,
        check_a_lost_scan_is_level_ground,
    ),
    "a teacher that sees the ground in dropouts": (
        _teacher_that_sees_what_the_student_cannot,
        check_dropouts_hide_the_same_ground_from_student_and_teacher,
    ),
    "dropouts of another robot": (
        lambda patch: patch.setattr(
            ScanLoss,
            "reset",
            lambda loss, env_ids, episodes, true=ScanLoss.reset: true(loss, env_ids * 0, episodes),
        ),
        check_dropouts_hide_the_same_ground_from_student_and_teacher,
    ),
    "a trained policy without its scan": (
        _policy_without_its_scan,
        check_the_policy_acts_as_the_student_in_training,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
