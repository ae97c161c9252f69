"""Tests of the check that a teacher walks before a network learns from it."""

from dataclasses import replace

import pytest

from evaluate.hardware import HardwareConfig
from quad_env.cli.command_line import UsageError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from train import teacher_check
from train.teacher_check import _ModifiedHardware, check_walking


@pytest.fixture(autouse=True)
def _few_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(teacher_check, "EPISODES", 2)


def test_a_controller_that_walks_passes() -> None:
    assert check_walking("trot_feedback", HardwareConfig()) == 1.0


def test_weak_motors_are_named() -> None:
    weak = replace(SIMPLE_QUAD, rated_torque=9.0)
    with pytest.raises(UsageError) as error:
        check_walking("trot_feedback", _ModifiedHardware(modified_robot=weak))
    assert str(error.value).startswith("trot_feedback does not walk on simple_quad: 0 of 2 episodes succeed; it walks ")
    assert "with joint torques of 22.5 instead of 9 N·m" in str(error.value)
    assert "\n" not in str(error.value)


def test_soft_servos_are_named() -> None:
    with pytest.raises(UsageError) as error:
        check_walking("trot", _ModifiedHardware(modified_robot=SIMPLE_QUAD.with_servo(40.0, 0.5)))
    assert "it walks with servos of 300 N·m/rad and 10 N·m·s/rad instead of 40 N·m/rad" in str(error.value)
    assert "joint torques" not in str(error.value)


def test_a_failure_without_explanation_says_so() -> None:
    with pytest.raises(UsageError, match="neither larger joint torques, nor stiffer servos, nor slower commands help"):
        check_walking("document", HardwareConfig())


def test_an_unknown_teacher_is_one_line() -> None:
    with pytest.raises(UsageError, match=r"--teacher: .*nonsense"):
        check_walking("nonsense", HardwareConfig())
