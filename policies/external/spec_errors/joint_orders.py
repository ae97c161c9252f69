"""Corrections of the joint order in a specification: left and right, fore and hind, by leg or by kind.

The kind of a joint is hip, thigh or calf. In an order by leg, the three joints of each leg are adjacent. In an order by
kind, the four joints of each kind are adjacent.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.external.joint_mapping import map_joints
from policies.external.spec import JOINT_FIELDS, PolicySpec
from policies.external.spec_errors.correction import ENDS, GROUPING, OBSERVED, ORDERS, SIDES, Correction
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG

JointOrder = NDArray[np.intp]
"""Joint order of a policy: index of each of its joints among the robot's joints, (12,)."""
Names = tuple[str, ...]
_OTHER_LEG = {SIDES: str.maketrans("lr", "rl"), ENDS: str.maketrans("fh", "hf")}
"""Error (SIDES or ENDS) -> table for `str.translate` that changes a leg's name into another leg's.

For example, SIDES changes `fl` into `fr`.
"""


def joint_order_in_words(joints: Names, robot: Robot) -> str:
    """Describe the order of twelve joints as text, for example `FL FR RL RR by leg`.

    Args:
        joints: Names of the joints.
        robot: Robot with these joints.

    Returns:
        Order of the legs, followed by `by leg` (the three joints of each leg are adjacent), `by kind` (first all hips,
        then all thighs, then all calves, or another order of these kinds) or `mixed`.
    """
    order = map_joints(joints, robot).joint_ids
    legs = dict.fromkeys(robot.leg_names[joint // JOINTS_PER_LEG] for joint in order.tolist())
    by_leg, by_kind = _grouped(order)
    grouping = "by leg" if np.array_equal(order, by_leg) else "by kind" if np.array_equal(order, by_kind) else "mixed"
    return f"{' '.join(legs).upper().replace('H', 'R')} {grouping}"


def reorder_joints(spec: PolicySpec, robot: Robot, count: int) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another order of the joints.

    Either only the joint names are reordered, or the names together with all fields that have one value per joint.

    Args:
        spec: Specification that may have an error.
        robot: Robot that the policy moves.
        count: Number of joint-order errors (ORDERS: left and right, fore and hind, by kind or by leg) that are
            corrected together, 1 to 3.

    Yields:
        Corrections of the joint order.
    """
    for errors in combinations(ORDERS, count):
        joints = _undo(spec.joints, errors, robot)
        observed = spec.observed_joints and _undo(spec.observed_joints, errors, robot)
        renamed = replace(spec, joints=joints, observed_joints=observed)
        kind = " and ".join(errors)
        order = joint_order_in_words(joints, robot)
        yield Correction(kind, f"the joint order {order}", "`joints`", renamed)
        reordered = replace(renamed, **_reordered_values(spec, joints))
        if reordered != renamed:
            changed_setting = f"joints and their figures in the order {order}"
            yield Correction(kind, changed_setting, "`joints` and what is in its order", reordered)


def reorder_observed_joints(spec: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another joint order of the observation.

    The joint order of the actions is unchanged. The new order of the observation is the order of the actions, or the
    specified order in which one joint-order error (ORDERS) is corrected, for example left and right.

    Args:
        spec: Specification that may have an error.
        robot: Robot that the policy moves.

    Yields:
        Corrections of the field `observed_joints`.
    """
    current = spec.observed_joints or spec.joints
    for order in (spec.joints, *(_undo(current, (error,), robot) for error in ORDERS)):
        changed_setting = f"joints observed in the order {joint_order_in_words(order, robot)}"
        observed = order if order != spec.joints else None
        yield Correction(OBSERVED, changed_setting, "`observed_joints`", replace(spec, observed_joints=observed))


def _reordered_values(spec: PolicySpec, joints: Names) -> dict[str, Any]:
    """Return the fields with one value per joint, in the order of `joints`: field name -> values."""
    order = [spec.joints.index(name) for name in joints]
    fields = {name: getattr(spec, name) for name in JOINT_FIELDS}
    return {name: values and tuple(values[index] for index in order) for name, values in fields.items()}


def _undo(joints: Names, errors: Iterable[str], robot: Robot) -> Names:
    """Return the joint names of a policy in the order that results if the errors are corrected.

    `errors` are names of ORDERS: SIDES exchanges left and right legs, ENDS exchanges fore and hind legs, and GROUPING
    changes an order by leg into an order by kind, and any other order into an order by leg.
    """
    given = map_joints(joints, robot).joint_ids
    order = given
    for error in errors:
        if error == GROUPING:
            by_leg, by_kind = _grouped(order)
            order = by_kind if np.array_equal(order, by_leg) else by_leg
        else:
            other_legs = [robot.leg_names.index(leg.translate(_OTHER_LEG[error])) for leg in robot.leg_names]
            order = JOINTS_PER_LEG * np.array(other_legs)[order // JOINTS_PER_LEG] + order % JOINTS_PER_LEG
    return tuple(joints[np.flatnonzero(given == joint)[0]] for joint in order)


def _grouped(order: JointOrder) -> tuple[JointOrder, JointOrder]:
    """Return a joint order grouped by leg, and the same joints grouped by kind (hip, thigh, calf).

    Legs and kinds keep the order of their first appearance in `order`.
    """
    leg_ids, link_ids = np.divmod(order, JOINTS_PER_LEG)
    leg_rank = _rank_of_first(leg_ids)
    link_rank = _rank_of_first(link_ids)
    return order[np.lexsort((link_rank, leg_rank))], order[np.lexsort((leg_rank, link_rank))]


def _rank_of_first(ids: JointOrder) -> NDArray[np.intp]:
    """Return, for each number in `ids`, the position of the first equal number in `ids`.

    Each of the numbers 0, 1, …, max(ids) must appear in `ids`.
    """
    first_indices: NDArray[np.intp] = np.unique(ids, return_index=True)[1]
    return first_indices[ids]
