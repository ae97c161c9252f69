"""Corrections of a specification that has one common error, for joint names and for joint values."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from policies.external.spec import JOINT_FIELDS, PolicySpec, SpecTerm
from policies.external.spec_errors import (
    ENDS,
    FRAMES,
    GAINS,
    GRAVITY,
    GROUPING,
    SIDES,
    Correction,
    corrections,
    joint_order_in_words,
)
from quad_env import SIMPLE_QUAD

BY_KIND = tuple(f"{leg}_{link}" for link in ("hip", "thigh", "calf") for leg in ("FL", "FR", "RL", "RR"))
BY_LEG = tuple(f"{leg}_{link}" for leg in ("FL", "FR", "RL", "RR") for link in ("hip", "thigh", "calf"))
COUNT = tuple(float(number) for number in range(1, 13))
"""Value that is different for each joint."""
TERMS = (
    SpecTerm("linear_velocity"),
    SpecTerm("angular_velocity", (0.25,)),
    SpecTerm("projected_gravity", (1.0, 2.0, 3.0)),
    SpecTerm("joint_position"),
)


def description(joints: tuple[str, ...] = BY_KIND, **fields: object) -> PolicySpec:
    given = {
        "default_position": tuple(0.01 * each for each in COUNT),
        "action_scale": tuple(0.1 * each for each in COUNT),
        "stiffness": COUNT,
        "damping": tuple(0.5 * each for each in COUNT),
        "target_clip": tuple((-each, each) for each in COUNT),
    }
    return PolicySpec(Path("policy.onnx"), 50.0, joints, terms=TERMS, **given | fields)  # type: ignore[arg-type]


def corrections_of(described: PolicySpec, mistake: str, count: int = 1) -> list[Correction]:
    return [each for each in corrections(described, SIMPLE_QUAD, count) if each.error == mistake]


def test_joints_by_kind_become_joints_by_leg_and_their_figures_go_with_their_names() -> None:
    """The first correction changes only names; the second also reorders hips 1-4, thighs 5-8, calves 9-12 by leg."""
    names, together = corrections_of(description(observed_joints=BY_LEG), GROUPING)
    assert names.spec == replace(description(), joints=BY_LEG, observed_joints=BY_KIND)
    assert names.keys_to_correct == "`joints`"
    assert names.changed_setting == "the joint order FL FR RL RR by leg"
    found = together.spec
    assert (found.joints, found.observed_joints) == (BY_LEG, BY_KIND)
    assert found.stiffness == (1.0, 5.0, 9.0, 2.0, 6.0, 10.0, 3.0, 7.0, 11.0, 4.0, 8.0, 12.0)
    for name in JOINT_FIELDS:
        of_names = dict(zip(BY_KIND, getattr(description(), name) or (None,) * 12, strict=True))
        assert getattr(found, name) in (None, tuple(of_names[joint] for joint in BY_LEG))
    assert found.action_offset is None
    assert together.keys_to_correct == "`joints` and what is in its order"
    assert together.changed_setting == "joints and their figures in the order FL FR RL RR by leg"


def test_joints_by_leg_become_joints_by_kind_and_their_figures_go_with_their_names() -> None:
    _, together = corrections_of(description(BY_LEG, action_offset=COUNT), GROUPING)
    assert together.spec.joints == BY_KIND
    by_hand = (1.0, 4.0, 7.0, 10.0, 2.0, 5.0, 8.0, 11.0, 3.0, 6.0, 9.0, 12.0)
    assert together.spec.stiffness == together.spec.action_offset == by_hand


@pytest.mark.parametrize(
    ("mistake", "legs", "order"),
    [
        (SIDES, ("FR", "FL", "RR", "RL"), (2, 1, 4, 3)),
        (ENDS, ("RL", "RR", "FL", "FR"), (3, 4, 1, 2)),
    ],
)
def test_legs_that_are_exchanged_have_each_other_s_names(
    mistake: str, legs: tuple[str, ...], order: tuple[int, ...]
) -> None:
    names, together = corrections_of(description(), mistake)
    expected = tuple(f"{leg}_{link}" for link in ("hip", "thigh", "calf") for leg in legs)
    assert names.spec.joints == together.spec.joints == expected
    assert names.spec.stiffness == COUNT
    assert together.spec.stiffness == tuple(4.0 * link + leg for link in range(3) for leg in order)


def test_two_mistakes_in_the_order_of_the_joints_are_undone_together() -> None:
    """Isaac Lab orders joints by kind from the left, Unitree by leg from the right."""
    names, _ = corrections_of(description(), f"{SIDES} and {GROUPING}", 2)
    expected = tuple(f"{leg}_{link}" for leg in ("FR", "FL", "RR", "RL") for link in ("hip", "thigh", "calf"))
    assert names.spec.joints == expected
    assert [each.error for each in corrections(description(), SIMPLE_QUAD, 2)][::2] == [
        f"{SIDES} and {ENDS}",
        f"{SIDES} and {GROUPING}",
        f"{ENDS} and {GROUPING}",
    ]


def test_figures_that_are_all_alike_leave_one_correction() -> None:
    alike = dict.fromkeys(("default_position", "action_scale", "stiffness", "damping"), (1.0,) * 12)
    assert len(corrections_of(description(**alike, target_clip=None), SIDES)) == 1


def test_an_order_is_told_in_words() -> None:
    assert joint_order_in_words(BY_KIND, SIMPLE_QUAD) == "FL FR RL RR by kind"
    assert joint_order_in_words(tuple(reversed(BY_LEG)), SIMPLE_QUAD) == "RR RL FR FL by leg"
    assert joint_order_in_words((*BY_LEG[1:], BY_LEG[0]), SIMPLE_QUAD) == "FL FR RL RR mixed"


def test_velocities_are_tried_in_every_other_frame_together_and_alone() -> None:
    found = corrections_of(description(), FRAMES)
    frames = [tuple(term.frame for term in each.spec.terms[:2]) for each in found]
    assert frames == [("world", "world"), ("world", "body"), ("body", "world")]
    assert [each.keys_to_correct for each in found] == [
        "`frame` of linear_velocity and angular_velocity",
        "`frame` of linear_velocity",
        "`frame` of angular_velocity",
    ]
    assert found[1].changed_setting == "linear_velocity in the world frame"
    assert all(each.spec.terms[2:] == TERMS[2:] for each in found)


def test_gravity_is_tried_the_other_way_and_nothing_else() -> None:
    (found,) = corrections_of(description(), GRAVITY)
    assert found.spec.terms == (*TERMS[:2], SpecTerm("projected_gravity", (-1.0, -2.0, -3.0)), TERMS[3])
    assert not corrections_of(replace(description(), terms=TERMS[:2]), GRAVITY)


def test_gains_are_tried_as_the_robot_s_own_and_far_off_in_the_order_of_the_joints() -> None:
    robot = replace_gains()
    found = [each.spec for each in corrections(description(), robot) if each.error == GAINS]
    by_kind = np.array(robot.servo_stiffness).reshape(4, 3).T.ravel()
    np.testing.assert_allclose(found[0].stiffness, by_kind)
    np.testing.assert_allclose(found[0].damping, np.array(robot.servo_damping).reshape(4, 3).T.ravel())
    both = [(factor, factor) for factor in (0.2, 0.45, 2.2, 5.0)]
    one = [(1.0, 0.1), (0.1, 1.0), (1.0, 10.0), (10.0, 1.0)]
    for each, (stiffer, damped) in zip(found[1:], (*both, *one), strict=True):
        np.testing.assert_allclose(each.stiffness, stiffer * np.array(COUNT))
        np.testing.assert_allclose(each.damping, 0.5 * damped * np.array(COUNT))


def replace_gains():  # type: ignore[no-untyped-def]
    """Return a robot with different gains for all servos."""
    return SIMPLE_QUAD.with_servo(300.0 + np.arange(12.0), 10.0 + 0.1 * np.arange(12.0))
