"""Corrections of a policy's specification: actions, control rate, signs of joints, servo gains."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.external.joint_mapping import map_joints
from policies.external.network_policy import with_spec_gains
from policies.external.spec import PolicySpec
from policies.external.spec_errors.correction import (
    ACTIONS,
    GAINS,
    POSITIONS,
    RATE,
    SIGNS,
    Correction,
    numbers_in_words,
)
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG

GAIN_FACTORS = 0.2, 0.45, 2.2, 5.0
"""Tried factors on the servo gains of a specification: stiffness and damping are multiplied together.

They are tried because the servo gains of many policies are not published.
"""
SINGLE_GAIN_FACTORS = 0.1, 10.0
"""Tried factors on one servo gain of a specification: the stiffness alone or the damping alone."""
ACTION_FACTORS = 0.25, 0.5, 2.0, 4.0
"""Tried factors on the action scale of all joints in a specification."""
HIP_FACTORS = 0.5, 2.0
"""Tried factors on the action scale of the hip joints (abduction) in a specification.

They are tried because forks of legged_gym reduce the action scale of the hips.
"""
RATES = 25.0, 100 / 3, 50.0, 100.0
"""Usual control rates of policies, Hz, that are tried as corrections of a specification."""
MIRRORED_PENALTY = 0.4
"""Penalty of a correction that reverses the signs and default positions of some joints.

The penalty is added to the deviation of the walk (velocity error divided by its tolerance). The penalty is
needed because the network can walk in another way with this correction, even if the specification has a different
error.
"""
ROBOT_GAINS_PENALTY = 0.1
"""Penalty of a corrected policy specification in which the servo gains are the robot's own, dimensionless.

Corrected specifications are compared by the relative velocity error of a test walk (velocity error divided by its
tolerance); the penalty is added to this error. It is needed because a policy often walks well with the robot's own
gains, even if the specified gains are right.
"""
_LINKS = "hip", "thigh", "calf"


def change_actions(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another action scale or offset.

    The action offset is the default position or zero.
    """
    for factor in ACTION_FACTORS:
        scale = tuple(factor * value for value in spec.action_scale)
        changed_setting = f"an action_scale of {numbers_in_words(scale)}"
        yield Correction(ACTIONS, changed_setting, "`action_scale`", replace(spec, action_scale=scale))
    is_hip = ["hip" in name.lower() or "haa" in name.lower() or name.lower().endswith("hx") for name in spec.joints]
    for factor in HIP_FACTORS if sum(is_hip) == 4 else ():
        scale = tuple(factor * value if hip else value for value, hip in zip(spec.action_scale, is_hip, strict=True))
        changed_setting = f"{factor:g} times the action_scale of the hips"
        yield Correction(ACTIONS, changed_setting, "`action_scale`", replace(spec, action_scale=scale))
    zeros = (0.0,) * len(spec.joints)
    for changed_setting, offset in (("targets from the default position", None), ("targets from zero", zeros)):
        yield Correction(POSITIONS, changed_setting, "`action_offset`", replace(spec, action_offset=offset))


def change_rate(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another control rate.

    The rates are the usual rates of policies (RATES), half the specified rate, and twice the specified rate, but at
    most the largest usual rate.
    """
    rates = *RATES, 0.5 * spec.control_rate, min(2.0 * spec.control_rate, RATES[-1])
    for rate in dict.fromkeys(rates):
        changed = replace(spec, control_rate=rate)
        yield Correction(RATE, f"a control rate of {rate:.4g} Hz", "`control_rate`", changed)


def change_signs(spec: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with opposite signs of some joints.

    The joints are the hips, thighs or calves, or several of these kinds, on all legs or on one side. In one correction
    the default positions of these joints are unchanged, in another they change their sign as well.

    Args:
        spec: Specification that may have an error.
        robot: Robot that the policy moves.

    Yields:
        Corrections of the field `signs`.
    """
    leg_ids, link_ids = np.divmod(map_joints(spec.joints, robot).joint_ids, JOINTS_PER_LEG)
    is_right = np.array([robot.leg_names[leg].endswith("r") for leg in leg_ids])
    for legs, mask, links in _sign_choices(is_right):
        joints = f"{' and '.join(_LINKS[link] for link in links)}{legs}"
        changed_setting = f"the sign of {joints} the other way"
        turns = np.where(mask & np.isin(link_ids, links), -1.0, 1.0)
        reversed_spec = _with_turned_signs(spec, turns)
        yield Correction(SIGNS, changed_setting, f"`signs` of {joints}", reversed_spec)
        mirrored = _with_turned_zeros(reversed_spec, turns)
        keys = f"`signs` and `default_position` of {joints}"
        yield Correction(SIGNS, f"{changed_setting}, default position too", keys, mirrored, MIRRORED_PENALTY)


def _with_turned_signs(spec: PolicySpec, turns: Floats) -> PolicySpec:
    """Return the specification with the signs of the joints multiplied by `turns`, each 1 or -1, (12,)."""
    signs = turns if spec.signs is None else turns * spec.signs
    return replace(spec, signs=None if (signs == 1.0).all() else tuple(signs.tolist()))


def _with_turned_zeros(spec: PolicySpec, turns: Floats) -> PolicySpec:
    """Return the specification with default position and action offset multiplied by `turns`, 1 or -1, (12,)."""
    offset = spec.action_offset and tuple((turns * spec.action_offset + 0.0).tolist())
    default_position = tuple((turns * spec.default_position + 0.0).tolist())
    return replace(spec, default_position=default_position, action_offset=offset)


def _sign_choices(is_right: Mask) -> list[tuple[str, NDArray[np.bool_], tuple[int, ...]]]:
    """Return the sets of joints for which `change_signs` reverses the sign of the joint angles.

    Each set is a tuple: text for the legs, mask of the joints of these legs, (12,), and kinds of the joints (0: hip, 1:
    thigh, 2: calf). `is_right` is True for the joints of the right legs, (12,).
    """
    every = np.ones(len(is_right), np.bool_)
    link_choices: tuple[tuple[int, ...], ...] = ((1, 2), (0,), (2,), (1,), (0, 1, 2))
    choices: list[tuple[str, NDArray[np.bool_], tuple[int, ...]]] = [("", every, links) for links in link_choices]
    for side, mask in (("right", is_right), ("left", ~is_right)):
        choices += [(f" of the {side} legs", mask, links) for links in ((0,), (0, 1, 2), (1, 2))]
    return choices


def change_gains(spec: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with other servo gains.

    The gains are the robot's own gains, or the specified gains with stiffness, damping or both multiplied by a factor.

    Args:
        spec: Specification that may have an error.
        robot: Robot that the policy moves.

    Yields:
        Corrections of the fields `stiffness` and `damping`.
    """
    joint_ids = map_joints(spec.joints, robot).joint_ids
    robot_gains = robot.gains[:, joint_ids]
    for penalty, gains in ((ROBOT_GAINS_PENALTY, robot_gains), *((0.0, gains) for gains in _scaled_gains(spec))):
        stiffness, damping = gains.tolist()
        changed = replace(spec, stiffness=tuple(stiffness), damping=tuple(damping))
        changed_setting = f"servo gains of {with_spec_gains(robot, changed).servo}"
        yield Correction(GAINS, changed_setting, "`stiffness` and `damping`", changed, penalty)


def _scaled_gains(spec: PolicySpec) -> list[Floats]:
    """Return servo gains to try, as arrays (2, 12): stiffness, N·m/rad, and damping, N·m·s/rad.

    Each array contains the gains of the specification `spec` after one change. Either stiffness and damping are both
    multiplied by a factor in GAIN_FACTORS, or only one of them is multiplied by a factor in SINGLE_GAIN_FACTORS.
    """
    gains = np.array((spec.stiffness, spec.damping))
    scaled = [factor * gains for factor in GAIN_FACTORS]
    for factor in SINGLE_GAIN_FACTORS:
        scaled += [np.array(factors)[:, None] * gains for factors in ((1.0, factor), (factor, 1.0))]
    return scaled
