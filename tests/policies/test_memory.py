"""Fields with a row for every robot: made, put back for some robots, along any axis, in parts too."""

from typing import Any

import numpy as np

from policies.memory import Memory, per_robot


class Part(Memory):
    ticks: Any = per_robot(0)


class Whole(Part):
    ticks: Any = per_robot(np.int8(3))
    past: Any = per_robot(lambda whole: np.full((2, 3), whole.first), axis=1)

    def __init__(self) -> None:
        self.first, self.part, self.parts = 0.5, Part(), {"other": Part()}


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
