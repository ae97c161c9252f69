"""Per-robot state: allocation, reset of some robots, any robot axis, nested states."""

from typing import Any

import numpy as np
import pytest

from policies.base import Actions, Policy, to_actions
from policies.memory import PerRobotState, initialize_state, lowpass_gain, per_robot, warm_start_gain
from quad_env.sensing.height_scan import table_with


class Part(PerRobotState):
    ticks: Any = per_robot(0)


class Whole(Part):
    ticks: Any = per_robot(np.int8(3))
    past: Any = per_robot(axis=1)

    def __init__(self) -> None:
        self.part = Part()
        self.parts = {"other": Part()}
        super().__init__(past=np.full((2, 3), 0.5))


def test_a_field_has_the_type_and_shape_of_its_start_for_every_robot_and_for_one_before_a_reset() -> None:
    whole = Whole()
    assert (whole.ticks.shape, whole.part.ticks.tolist()) == ((1,), [0])
    whole.reset(4)
    assert (whole.ticks.dtype, whole.ticks.tolist()) == (np.int8, [3] * 4)  # dtype of the subclass, not of `Part`
    np.testing.assert_array_equal(whole.past, np.full((2, 4, 3), 0.5))
    assert whole.part.ticks.shape == whole.parts["other"].ticks.shape == (4,)


def test_some_robots_begin_again_and_arrays_that_were_handed_out_stay_what_they_were() -> None:
    whole, mask = Whole(), np.array([True, False, True])
    whole.reset(3)
    for part in (whole, whole.part, whole.parts["other"]):
        part.ticks += 5
    whole.past[:] = 9.0
    before = whole.ticks
    whole.reset_where(mask)
    assert (whole.ticks.tolist(), before.tolist()) == ([3, 8, 3], [8, 8, 8])
    np.testing.assert_array_equal(whole.past, np.broadcast_to(np.where(mask, 0.5, 9.0)[None, :, None], (2, 3, 3)))
    assert whole.part.ticks.tolist() == whole.parts["other"].ticks.tolist() == [0, 5, 0]


def test_some_robots_go_on_as_those_of_another_in_every_part() -> None:
    """The robots of the mask are copied; the others keep their state, and previously returned arrays do not change."""
    own, other, mask = Whole(), Whole(), np.array([True, False, True])
    own.reset(3)
    other.reset(2)
    for place, part in enumerate((other, other.part, other.parts["other"])):
        part.ticks += np.array([10, 20], part.ticks.dtype) + place
    other.past[:] = np.array([4.0, 5.0])[:, None]
    before = own.ticks
    own.copy_state_from(mask, other)
    assert (own.ticks.tolist(), before.tolist()) == ([13, 3, 23], [3, 3, 3])
    assert (own.part.ticks.tolist(), own.parts["other"].ticks.tolist()) == ([11, 0, 21], [12, 0, 22])
    np.testing.assert_array_equal(own.past[:, :, 0], [[4.0, 0.5, 5.0]] * 2)
    own.ticks += 1
    assert other.ticks.tolist() == [13, 23]


def test_a_filter_takes_in_its_share_and_at_first_the_mean() -> None:
    """The gain is 0.01 / (0.01 + 0.04), or 1 / k in the k-th of the first updates."""
    np.testing.assert_allclose(lowpass_gain(0.01, 0.04), 0.2)
    np.testing.assert_allclose(warm_start_gain(0.2, np.array([0, 1, 2, 4, 5, 9])), [1.0, 1.0, 0.5, 0.25, 0.2, 0.2])


class Leaning(Policy):
    """User policy with an initial value by a function of the object, and `_restart` under its old name."""

    name = "leaning"
    targets: Any = per_robot(lambda policy: policy.robot.home_pose + policy.lean)
    steps: Any = per_robot(0)

    def __init__(self) -> None:
        super().__init__()
        self.lean = 0.1
        self.restarted: list[list[bool]] = []

    def _restart(self, mask: Any) -> None:
        super()._restart(mask)
        self.restarted.append(mask.tolist())

    def _act(self, observation: Any) -> Actions:
        self.steps += 1
        return to_actions(self.robot, self.targets)


def test_a_policy_of_a_user_acts_without_a_reset_and_its_restart_is_still_called() -> None:
    policy = Leaning()
    assert policy.steps.tolist() == [0]
    observation = np.zeros(table_with(policy.robot, None).size, np.float32)
    np.testing.assert_allclose(policy.act(observation), policy.robot.home_pose + 0.1, atol=1e-6)
    policy.lean = 0.2
    policy.reset(2)
    policy.act(np.tile(observation, (2, 1)))
    policy.lean = 0.3
    policy.reset_where(np.array([True, False]))
    assert policy.restarted == [[True, False]]
    assert policy.steps.tolist() == [0, 1]
    np.testing.assert_allclose(policy.targets - policy.robot.home_pose, [[0.3] * 12, [0.2] * 12])


def test_an_initial_value_is_declared_and_given() -> None:
    """A name without a declaration in a class, and an array without an initial value, are refused."""
    with pytest.raises(TypeError, match="Part: no array turns declared with per_robot"):
        initialize_state(Part(), turns=0)
    whole = Whole.__new__(Whole)
    with pytest.raises(TypeError, match=r"Whole\.past: no initial value; pass it to initialize_state"):
        whole.reset(1)
