"""Mapping of an external policy's joints to a robot's joints: names, order, signs and zeros.

The joint angles of this project's robots are zero if the leg points straight down. They are positive for rotations
about +x or +y (see `quad_env.robots.scene`). The joint angles of an external policy follow the model on which the
policy was trained. The mapping assumes that this model is the model file of the robot. Then
`robot_angle = zero + sign * policy_angle` holds for each joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, PolicyError
from policies.external.spec import PolicySpec
from quad_env.robots.leg_names import leg_from_words, split_words
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG, LINK_WORDS

LINK_INDICES = LINK_WORDS | {
    **dict.fromkeys(("abduction", "abductor", "hx", "hipx", "x", "roll"), "0"),
    **dict.fromkeys(("upper", "hy", "hipy"), "1"),
    **dict.fromkeys(("lower", "shank", "shin", "kn"), "2"),
    **dict.fromkeys(("y", "pitch"), "12"),
}
"""Word in a joint's name -> possible indices of the joint in its leg, written as digits.

The indices are 0 for the hip (abduction), 1 for the thigh and 2 for the calf (knee); `12` means thigh or calf.
"""


@dataclass(frozen=True)
class JointMapping:
    """Mapping of an external policy's joints to a robot's joints: indices, signs and zeros, each (12,)."""

    joint_ids: NDArray[np.intp]
    """Index of each joint of the policy among the robot's joints, in the policy's joint order, (12,)."""
    signs: Floats
    """-1 if the policy's joint turns opposite to the robot's joint, else 1, in the policy's order, (12,)."""
    zeros: Floats
    """Robot joint angles at which the policy's joint angles are zero, in the policy's order, (12,), rad."""

    def policy_angles(self, robot_angles: Floats) -> Floats:
        """Convert the robot's joint angles to the policy's joint order, signs and zeros, (n, 12), rad."""
        return self.signs * (robot_angles[:, self.joint_ids] - self.zeros)

    def policy_rates(self, robot_rates: Floats) -> Floats:
        """Convert the robot's joint velocities or torques to the policy's joint order and signs, (n, 12).

        The unit of the result is the unit of the argument, rad/s or N·m.
        """
        return self.signs * robot_rates[:, self.joint_ids]

    def robot_angles(self, policy_angles: Floats) -> Floats:
        """Convert the policy's joint angles to the robot's joint order, signs and zeros, (n, 12), rad."""
        return self.to_robot_order(self.zeros + self.signs * policy_angles)

    def to_robot_order(self, values: Floats) -> Floats:
        """Reorder values per joint, (…, 12), from the policy's joint order to the robot's joint order."""
        reordered = np.empty_like(values)
        reordered[..., self.joint_ids] = values
        return reordered


def map_joints(names: Sequence[str], robot: Robot) -> JointMapping:
    """Map the joint names in a policy's file to a robot's joints.

    Raises PolicyError if a name fits no joint of the robot.

    Args:
        names: Joint names of the robot, in upper or lower case, or other names that contain words for leg and link, for
            example `FL_hip_joint`.
        robot: Robot that the policy moves.

    Returns:
        Mapping in the order of `names`; its signs and zeros convert angles of the robot's model file.
    """
    joint_ids = np.array(_match_exactly(names, robot) or _match_by_words(names, robot))
    signs, zeros = _model_file_convention(robot)
    return JointMapping(joint_ids, signs[joint_ids], zeros[joint_ids])


def map_action_joints(spec: PolicySpec, robot: Robot) -> JointMapping:
    """Return the mapping from a policy's joints, in the order of the actions in `spec`, to a robot's joints."""
    return _map_spec_joints(spec.joints, spec, robot)


def map_observed_joints(spec: PolicySpec, robot: Robot) -> JointMapping:
    """Return the mapping from a policy's joints, in the observed order in `spec`, to a robot's joints."""
    return _map_spec_joints(spec.observed_joints or spec.joints, spec, robot)


def _map_spec_joints(names: Sequence[str], spec: PolicySpec, robot: Robot) -> JointMapping:
    """Return the mapping from the joints `names` of a specification to the joints of a robot.

    The mapping combines the signs and zeros of the specification with the signs and zeros of the robot's model file.
    """
    mapping = map_joints(names, robot)
    order = [spec.joints.index(name) for name in names]
    signs = np.ones(len(order)) if spec.signs is None else np.array(spec.signs)[order]
    zeros = np.zeros(len(order)) if spec.zeros is None else np.array(spec.zeros)[order]
    return JointMapping(mapping.joint_ids, mapping.signs * signs, mapping.zeros + mapping.signs * zeros)


def _match_exactly(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the indices of the robot's joints with the given names, in the order of the names.

    Upper and lower case are equal. The list is empty unless the names are all joint names of the robot, each once.
    """
    index_by_name = {name.lower(): index for index, name in enumerate(robot.joint_names)}
    indices = [index_by_name.get(name.lower(), -1) for name in names]
    return indices if sorted(indices) == list(range(len(index_by_name))) else []


def _match_by_words(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the indices of the robot's joints that fit the words for leg and link in the given names.

    Raises PolicyError, which quotes the first name that fits no joint.
    """
    words = [split_words(name) for name in names]
    legs = [leg_from_words(each) for each in words]
    joint_of = dict[int, int]()
    for leg_index, leg in enumerate(robot.leg_names):
        of_leg = [index for index, other in enumerate(legs) if other == leg]
        if len(of_leg) != JOINTS_PER_LEG:
            continue
        link_orders = _possible_link_orders([words[index] for index in of_leg])
        if len(link_orders) == 1:
            for index, link in zip(of_leg, link_orders[0], strict=True):
                joint_of[index] = JOINTS_PER_LEG * leg_index + link
    if len(names) == len(joint_of) == robot.num_joints:
        return [joint_of[index] for index in range(len(names))]
    unknown = next((name for index, name in enumerate(names) if index not in joint_of), None)
    fault = f"moves {len(names)} joints" if unknown is None else f"moves the joint {unknown!r}, which fits none"
    raise PolicyError(f"the policy {fault} of {robot.name}, whose joints are {', '.join(robot.joint_names)}")


def _possible_link_orders(leg: Sequence[Sequence[str]]) -> list[tuple[int, ...]]:
    """Return the permutations of hip (0), thigh (1) and calf (2) that the joint names of a leg allow.

    `leg` has one list per joint name, with the words of the name.
    """
    possible_links = [[set(LINK_INDICES[word]) for word in words if word in LINK_INDICES] for words in leg]
    return [order for order in permutations(range(JOINTS_PER_LEG)) if _is_possible(order, possible_links)]


def _is_possible(order: Sequence[int], possible_links: Sequence[Sequence[set[str]]]) -> bool:
    """Return True if the words in the three joint names of a leg allow the link indices in `order`.

    `possible_links` has one list per joint name. It contains, for each word for a link in the name, the set of link
    indices (as digits) that the word allows. A joint name must contain at least one word for a link.
    """
    for link, link_sets in zip(order, possible_links, strict=True):
        if not link_sets or not all(str(link) in links for links in link_sets):
            return False
    return True


@cache
def _model_file_convention(robot: Robot) -> tuple[Floats, Floats]:
    """Return signs and zeros, rad, each (12,), that convert angles of the model file to robot angles.

    For each joint, `robot_angle = zero + sign * angle`, where `angle` is the joint angle in the robot's model file.
    The robot angles are zero if the legs point straight down.
    """
    if not robot.imported:
        return np.ones(robot.num_joints), np.zeros(robot.num_joints)
    model = robot.user_model.model
    structure = robot.user_model.structure
    model_zeros = model.qpos0[model.jnt_qposadr[structure.joints]]
    return structure.signs, structure.joint_offsets - structure.signs * model_zeros
