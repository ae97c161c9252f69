"""Faults in a distillation: labels of another state, memory of an earlier episode, another network than the trained."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from policies.history import Inputs
from policies.mpc.model_based import ModelBased
from policies.network import Network
from policies.residual import Features
from tests.planted_faults.harness import Faults, checks_of, fault_tests
from tests.train.distillation import test_collection
from train.distillation import student
from train.distillation.collection import LabelCollector
from train.distillation.student import StudentNetwork
from train.distillation.teacher import PrivilegedTeacher


def check_a_label_is_of_the_present_state() -> None:
    test_collection.test_a_label_is_of_the_state_that_the_student_observes(0.0)


def check_the_teacher_observes_the_true_state() -> None:
    test_collection.test_the_teacher_observes_the_present_state_though_the_student_does_not()


def check_the_teacher_is_reset_with_its_robot() -> None:
    test_collection.test_the_teacher_is_reset_with_its_robot()


def check_the_teacher_has_the_clock_of_the_student() -> None:
    test_collection.test_a_model_based_teacher_has_the_gait_clock_of_the_student()


def check_the_policy_acts_as_the_student_in_training() -> None:
    with pytest.MonkeyPatch.context() as patch:
        test_collection.test_the_students_policy_does_in_evaluation_as_in_training(
            1, Inputs((0.02,), (0.3,), 2.5), patch
        )


def _labels_of_the_step_before(patch: pytest.MonkeyPatch) -> None:
    true_label = LabelCollector._label

    def label(collector: Any) -> Any:
        inputs, corrections = true_label(collector)
        before = getattr(collector, "before", corrections)
        collector.before = corrections
        return inputs, before

    patch.setattr(LabelCollector, "_label", label)


def _teacher_on_the_students_readings(patch: pytest.MonkeyPatch) -> None:
    true_start, true_step = LabelCollector.start_segment, LabelCollector._step

    def show(collector: Any) -> None:
        collector._teacher._robots.true_observation = lambda *_, **__: collector._observation

    def start(collector: Any, *arguments: Any) -> None:
        true_start(collector, *arguments)
        show(collector)

    def step(collector: Any, actions: Any) -> Any:
        fell = true_step(collector, actions)
        show(collector)
        return fell

    patch.setattr(LabelCollector, "start_segment", start)
    patch.setattr(LabelCollector, "_step", step)


def _history_of_the_episode_before(patch: pytest.MonkeyPatch) -> None:
    true_label = LabelCollector._label

    def label(collector: Any) -> Any:
        with pytest.MonkeyPatch.context() as inner:
            inner.setattr(Features, "reset_where", lambda *_: None)
            return true_label(collector)

    patch.setattr(LabelCollector, "_label", label)


def _another_clock(patch: pytest.MonkeyPatch) -> None:
    true_make = student.make_policy
    patch.setattr(
        test_collection,
        "make_policy",
        lambda config, robot, network, inputs: true_make(config, robot, network, replace(inputs, clock=2.0)),
    )


def _normalisation_that_is_not_folded(patch: pytest.MonkeyPatch) -> None:
    def to_network(network: StudentNetwork) -> Network:
        weights = tuple(np.ascontiguousarray(layer.weight.detach().numpy().T) for layer in network.layers)
        return Network(weights, tuple(layer.bias.detach().numpy() for layer in network.layers))

    patch.setattr(StudentNetwork, "to_network", to_network)


FAULTS: Faults = {
    "labels of the step before": (_labels_of_the_step_before, check_a_label_is_of_the_present_state),
    "a teacher on the student's delayed readings": (
        _teacher_on_the_students_readings,
        check_the_teacher_observes_the_true_state,
    ),
    "a teacher that is not reset with its robot": (
        lambda patch: patch.setattr(PrivilegedTeacher, "reset_where", lambda *_: None),
        check_the_teacher_is_reset_with_its_robot,
    ),
    "a student's history that is not reset with its robot": (
        _history_of_the_episode_before,
        check_the_policy_acts_as_the_student_in_training,
    ),
    "a teacher with a gait clock of its own": (
        lambda patch: patch.setattr(ModelBased, "set_gait_clock", lambda *_: None),
        check_the_teacher_has_the_clock_of_the_student,
    ),
    "another clock in evaluation than in training": (_another_clock, check_the_policy_acts_as_the_student_in_training),
    "a normalisation that is not folded": (
        _normalisation_that_is_not_folded,
        check_the_policy_acts_as_the_student_in_training,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
