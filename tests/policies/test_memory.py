"""Fields with a row for every robot: made, put back for some robots, along any axis, in parts too."""

from typing import Any

import numpy as np

from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain


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
    assert (whole.ticks.dtype, whole.ticks.tolist()) == (np.int8, [3] * 4)  # the subclass's, not that of `Part`
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
    """As many robots as the mask has; the others keep their own, and arrays that were handed out do not change."""
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
    """0.01 / (0.01 + 0.04) of a change; of the k-th of few looks 1 / k."""
    np.testing.assert_allclose(lowpass_gain(0.01, 0.04), 0.2)
    np.testing.assert_allclose(warm_start_gain(0.2, np.array([0, 1, 2, 4, 5, 9])), [1.0, 1.0, 0.5, 0.25, 0.2, 0.2])
