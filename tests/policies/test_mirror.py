"""Left and right exchanged, by hand and by axioms, and bases that do not care which is which.

That a robot and its mirror image move alike is seen in tests/train/sb3/test_symmetry.py.
"""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

import policies
from policies.base import GaitedPolicy
from policies.bases import BASES
from policies.gait import BOUND_OFFSETS, PACE_OFFSETS, PRONK_OFFSETS, TROT_OFFSETS, WALK_OFFSETS
from policies.history import Inputs
from policies.mirror import correction_mirror, features_mirror, leg_mirror, observation_mirror, phase_sign
from policies.residual import NO_SHIFT, Features, Space
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.simple_quad import JOINT_NAMES, SIMPLE_QUAD

SHIFT = np.array([0.2, 0.3, 0.4, 0.5, 0.0, 0.05, 0.06, 0.07], np.float32)
MEMORY = Inputs((0.03,), (0.1, 0.2), 1.5)


@pytest.mark.parametrize("base", ["trot", "bound", "stand"])
@pytest.mark.parametrize(("inputs", "shift"), [(Inputs(), NO_SHIFT), (MEMORY, SHIFT)])
def test_the_mirror_image_of_a_mirror_image_is_what_was_there(base, inputs, shift):
    walker = policies.make(base)
    seen = features_mirror(walker, inputs, shift)
    for mirror in (seen, *(correction_mirror(SIMPLE_QUAD, shift, space) for space in get_args(Space))):
        rows = np.random.default_rng(0).normal(size=(5, len(mirror.sign))).astype(np.float32)
        np.testing.assert_array_equal(mirror(mirror(rows)), rows)
        assert (mirror(rows) != rows).any(axis=1).all()
    assert len(seen.sign) == Features(walker, inputs, shift).width


def test_a_leg_in_the_mirror_is_the_one_across_abducted_the_other_way():
    mirrored = leg_mirror(SIMPLE_QUAD)(np.arange(1.0, 13.0))
    assert dict(zip(JOINT_NAMES, mirrored.tolist(), strict=True)) == {
        "fl_hip_joint": -4.0,
        "fl_thigh_joint": 5.0,
        "fl_calf_joint": 6.0,
        "fr_hip_joint": -1.0,
        "fr_thigh_joint": 2.0,
        "fr_calf_joint": 3.0,
        "hl_hip_joint": -10.0,
        "hl_thigh_joint": 11.0,
        "hl_calf_joint": 12.0,
        "hr_hip_joint": -7.0,
        "hr_thigh_joint": 8.0,
        "hr_calf_joint": 9.0,
    }


def test_a_robot_that_goes_left_and_turns_left_goes_right_and_turns_right():
    observation = np.zeros(OBSERVATION_SIZE, np.float32)
    for name in ("projected_gravity", "angular_velocity", "linear_velocity", "command"):
        observation[OBSERVATION[name]] = 1.0, 2.0, 3.0
    mirrored = observation_mirror(SIMPLE_QUAD)(observation)
    assert mirrored[OBSERVATION["projected_gravity"]].tolist() == [1.0, -2.0, 3.0]
    assert mirrored[OBSERVATION["angular_velocity"]].tolist() == [-1.0, 2.0, -3.0]
    assert mirrored[OBSERVATION["linear_velocity"]].tolist() == [1.0, -2.0, 3.0]
    assert mirrored[OBSERVATION["command"]].tolist() == [1.0, -2.0, -3.0]


def test_a_correction_to_the_left_is_one_to_the_right_and_a_faster_gait_is_faster():
    correction = np.arange(19, dtype=np.float32)
    assert correction_mirror(SIMPLE_QUAD, SHIFT)(correction)[12:].tolist() == [12, -13, -14, 15, 16, 17, -18]
    feet = correction_mirror(SIMPLE_QUAD, space="feet")(correction[:12])
    assert feet.tolist() == [3.0, -4.0, 5.0, 0.0, -1.0, 2.0, 9.0, -10.0, 11.0, 6.0, -7.0, 8.0]


def test_features_over_a_trot_are_mirrored_part_by_part():
    """Phase and clock half a cycle on, the base's action as joints, what is remembered as observations."""
    mirror = features_mirror(policies.make("trot"), MEMORY, SHIFT)
    seen = np.random.default_rng(0).normal(size=len(mirror.sign)).astype(np.float32)
    k, joints, observation = OBSERVATION_SIZE, leg_mirror(SIMPLE_QUAD), observation_mirror(SIMPLE_QUAD)
    parts = np.split(seen, np.cumsum([k, 2, 12, 2, k, k, k]))
    expected = [observation, np.negative, joints, np.negative, observation, observation, observation]
    images = [image(part) for image, part in zip(expected, parts, strict=False)]
    np.testing.assert_array_equal(mirror(seen), np.concatenate((*images, parts[-1] * [1, -1, -1, 1, 1, 1, -1])))


def test_left_and_right_are_half_a_cycle_apart_or_together_or_the_gait_has_no_mirror_image():
    assert {phase_sign(SIMPLE_QUAD, offsets) for offsets in (TROT_OFFSETS, WALK_OFFSETS, PACE_OFFSETS)} == {-1}
    assert {phase_sign(SIMPLE_QUAD, offsets) for offsets in (BOUND_OFFSETS, PRONK_OFFSETS)} == {1}
    assert phase_sign(SIMPLE_QUAD, (0.0, -np.pi, 7 * np.pi, 0.0)) == -1
    gallop = (0.0, 0.2 * np.pi, np.pi, 1.2 * np.pi)
    hind_legs_together = (0.0, np.pi, 0.0, 0.0)
    for offsets in (gallop, hind_legs_together):
        with pytest.raises(ValueError, match="has another for its mirror image"):
            phase_sign(SIMPLE_QUAD, offsets)
    galloping = policies.make("trot")
    galloping.leg_offsets = gallop
    with pytest.raises(ValueError, match="mirror image"):
        features_mirror(galloping)


def test_a_robot_whose_sides_differ_has_no_mirror_image():
    crooked = replace(SIMPLE_QUAD, hip_positions=SIMPLE_QUAD.hip_positions + np.arange(4)[:, None] * 0.01)
    with pytest.raises(ValueError, match="across"):
        observation_mirror(crooked)
    leaning = replace(SIMPLE_QUAD, home_pose=SIMPLE_QUAD.home_pose + 0.1)
    with pytest.raises(ValueError, match="stands at home"):
        observation_mirror(leaning)


@pytest.mark.parametrize("name", BASES)
def test_every_base_answers_the_mirror_image_with_the_mirror_image(name):
    """Two robots, of which one is shown what the other would see in the mirror; its clock begins as the mirror says."""
    base, observation, joints = policies.make(name), observation_mirror(SIMPLE_QUAD), leg_mirror(SIMPLE_QUAD)
    base.reset(2)
    if isinstance(base, GaitedPolicy):
        half = phase_sign(SIMPLE_QUAD, base.leg_offsets) < 0
        base._phase = np.array([0.1, 0.1 + np.pi * half])
    generator, size = np.random.default_rng(0), np.zeros(OBSERVATION_SIZE)
    for part, spread in {"projected_gravity": 0.1, "angular_velocity": 0.5, "linear_velocity": 0.3}.items():
        size[OBSERVATION[part]] = spread
    size[OBSERVATION["joint_position"]] = 0.2
    level = np.zeros(OBSERVATION_SIZE)
    level[OBSERVATION["projected_gravity"]] = 0.0, 0.0, -1.0
    for step in range(60):
        level[OBSERVATION["command"]] = [(0.8, 0.3, 0.6), (-0.5, 0.6, -1.0)][step // 30]
        seen = (level + size * generator.normal(size=OBSERVATION_SIZE)).astype(np.float32)
        one, other = base.act(np.stack((seen, observation(seen))))
        np.testing.assert_allclose(other, joints(one), atol=1e-6)
