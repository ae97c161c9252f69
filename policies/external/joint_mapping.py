"""Joints of an external policy on a robot: their names, order, signs and zeros.

A robot's angles are zero with the leg straight down and grow about +x or +y (see `quad_env.robots.scene`). A policy's
angles follow its maker's model; the robot's own model file is taken as this model. A robot's angle is
zero + sign * the policy's angle.
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
"""Possible indices in the leg of a word in a joint's name, counted from the trunk, as digits."""


@dataclass(frozen=True)
class JointMapping:
    """Joints of a robot in the order of a policy, with the conversion of their angles; arrays (12,)."""

    joint_ids: NDArray[np.intp]
    """Indices of the policy's joints among the robot's."""
    signs: Floats
    """1, or -1 where the directions of the policy's and the robot's joint differ."""
    zeros: Floats
    """Angles of the robot's joints at the policy's zero, rad."""

    def policy_angles(self, robot_angles: Floats) -> Floats:
        """Return the policy's joint angles for the robot's, (n, 12), rad."""
        return self.signs * (robot_angles[:, self.joint_ids] - self.zeros)

    def policy_rates(self, robot_rates: Floats) -> Floats:
        """Return the policy's joint speeds or torques for the robot's, (n, 12), rad/s or N·m."""
        return self.signs * robot_rates[:, self.joint_ids]

    def robot_angles(self, policy_angles: Floats) -> Floats:
        """Return the robot's joint angles for the policy's, (n, 12), rad."""
        return self.to_robot_order(self.zeros + self.signs * policy_angles)

    def to_robot_order(self, values: Floats) -> Floats:
        """Return values in the order of the policy, (…, 12), in the order of the robot's joints."""
        reordered = np.empty_like(values)
        reordered[..., self.joint_ids] = values
        return reordered


def map_joints(names: Sequence[str], robot: Robot) -> JointMapping:
    """Map joint names to a robot's joints; names that fit none raise PolicyError.

    Args:
        names: The robot's own names, in any case, or other names that contain leg and link.
        robot: The robot.

    Returns:
        Mapping in the order of `names`.
    """
    joint_ids = np.array(_match_exactly(names, robot) or _match_by_words(names, robot))
    signs, zeros = _model_file_convention(robot)
    return JointMapping(joint_ids, signs[joint_ids], zeros[joint_ids])


def map_action_joints(spec: PolicySpec, robot: Robot) -> JointMapping:
    """Map the joints of `spec`, in the order of its actions, to the joints of `robot`."""
    return _map_spec_joints(spec.joints, spec, robot)


def map_observed_joints(spec: PolicySpec, robot: Robot) -> JointMapping:
    """Map the joints of `spec`, in the order of its observation, to the joints of `robot`."""
    return _map_spec_joints(spec.observed_joints or spec.joints, spec, robot)


def _map_spec_joints(names: Sequence[str], spec: PolicySpec, robot: Robot) -> JointMapping:
    """Return the mapping of names with the specification's signs and zeros on top of the robot file's."""
    mapping = map_joints(names, robot)
    order = [spec.joints.index(name) for name in names]
    signs = np.ones(len(order)) if spec.signs is None else np.array(spec.signs)[order]
    zeros = np.zeros(len(order)) if spec.zeros is None else np.array(spec.zeros)[order]
    return JointMapping(mapping.joint_ids, mapping.signs * signs, mapping.zeros + mapping.signs * zeros)


def _match_exactly(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the indices of the joints with these names if they are all of the robot's, each once; else no index."""
    index_by_name = {name.lower(): index for index, name in enumerate(robot.joint_names)}
    indices = [index_by_name.get(name.lower(), -1) for name in names]
    return indices if sorted(indices) == list(range(len(index_by_name))) else []


def _match_by_words(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the indices of the joints by the words in the names. Raises PolicyError with the first unknown name."""
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
    """Return all orders of hip, thigh and calf that the words of a leg's three joint names allow."""
    possible_links = [[set(LINK_INDICES[word]) for word in words if word in LINK_INDICES] for words in leg]
    return [order for order in permutations(range(JOINTS_PER_LEG)) if _is_possible(order, possible_links)]


def _is_possible(order: Sequence[int], possible_links: Sequence[Sequence[set[str]]]) -> bool:
    """Return True if every joint has a link word or more, and all of them allow its link in this order."""
    for link, link_sets in zip(order, possible_links, strict=True):
        if not link_sets or not all(str(link) in links for links in link_sets):
            return False
    return True


@cache
def _model_file_convention(robot: Robot) -> tuple[Floats, Floats]:
    """Return signs and zeros of the robot's joints relative to its model file, (12,) each, zeros in rad."""
    if not robot.imported:
        return np.ones(robot.num_joints), np.zeros(robot.num_joints)
    model = robot.user_model.model
    structure = robot.user_model.structure
    model_zeros = model.qpos0[model.jnt_qposadr[structure.joints]]
    return structure.signs, structure.joint_offsets - structure.signs * model_zeros
