"""The joints of a policy from another project on a robot: which of its joints each name means, their signs and zeros.

Robots' angles are zero with the leg straight down and grow about +x or +y (see `quad_env.robots.scene`); a policy's are
those of its maker's model, for which the robot's own model file stands. A robot's angle is zero + sign * the policy's.
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
"""Places in the leg that a word of a joint's name may mean, counted from the trunk."""


@dataclass(frozen=True)
class JointMapping:
    """Joints of a robot in the order of a policy; arrays (12,)."""

    joint_ids: NDArray[np.intp]
    """Of the policy's joints among the robot's."""
    signs: Floats
    zeros: Floats
    """rad"""

    def policy_angles(self, robots: Floats) -> Floats:
        """The policy's angles, (n, 12), rad, of the robot's."""
        return self.signs * (robots[:, self.joint_ids] - self.zeros)

    def policy_rates(self, robots: Floats) -> Floats:
        """The policy's speeds or torques, (n, 12), of the robot's."""
        return self.signs * robots[:, self.joint_ids]

    def robot_angles(self, angles: Floats) -> Floats:
        """The robot's angles, (n, 12), rad, of the policy's."""
        return self.to_robot_order(self.zeros + self.signs * angles)

    def to_robot_order(self, values: Floats) -> Floats:
        """Values (…, 12) in the order of the robot's joints."""
        found = np.empty_like(values)
        found[..., self.joint_ids] = values
        return found


def map_joints(names: Sequence[str], robot: Robot) -> JointMapping:
    """A robot's joints of these names: its own, in any case, or others that say leg and link. Raises PolicyError."""
    places = np.array(_exact(names, robot) or _by_words(names, robot))
    signs, zeros = _convention(robot)
    return JointMapping(places, signs[places], zeros[places])


def map_action_joints(description: PolicySpec, robot: Robot) -> JointMapping:
    """Return the robot's joints in the order of a policy's actions. Raises PolicyError."""
    return _of_description(description.joints, description, robot)


def map_observed_joints(description: PolicySpec, robot: Robot) -> JointMapping:
    """Return the robot's joints in the order in which a policy observes them. Raises PolicyError."""
    return _of_description(description.observed_joints or description.joints, description, robot)


def _of_description(names: Sequence[str], description: PolicySpec, robot: Robot) -> JointMapping:
    """Return joints of those names with the description's signs and zeros on top of the robot file's."""
    found = map_joints(names, robot)
    order = [description.joints.index(name) for name in names]
    signs = np.ones(len(order)) if description.signs is None else np.array(description.signs)[order]
    zeros = np.zeros(len(order)) if description.zeros is None else np.array(description.zeros)[order]
    return JointMapping(found.joint_ids, found.signs * signs, found.zeros + found.signs * zeros)


def _exact(names: Sequence[str], robot: Robot) -> list[int]:
    """Places of the joints that are called so, if all are there, once each."""
    own = {name.lower(): place for place, name in enumerate(robot.joint_names)}
    places = [own.get(name.lower(), -1) for name in names]
    return places if sorted(places) == list(range(len(own))) else []


def _by_words(names: Sequence[str], robot: Robot) -> list[int]:
    """Places of the joints that the names describe. Raises PolicyError, which names the first that describes none."""
    words = [split_words(name) for name in names]
    legs = [leg_from_words(each) for each in words]
    places = dict[int, int]()
    for number, leg in enumerate(robot.leg_names):
        its = [index for index, found in enumerate(legs) if found == leg]
        if len(its) == JOINTS_PER_LEG and len(fits := _links([words[index] for index in its])) == 1:
            places |= {index: JOINTS_PER_LEG * number + link for index, link in zip(its, fits[0], strict=True)}
    if len(names) == len(places) == robot.num_joints:
        return [places[index] for index in range(len(names))]
    first = next((name for index, name in enumerate(names) if index not in places), None)
    fault = f"moves {len(names)} joints" if first is None else f"moves the joint {first!r}, which fits none"
    raise PolicyError(f"the policy {fault} of {robot.name}, whose joints are {', '.join(robot.joint_names)}")


def _links(leg: Sequence[Sequence[str]]) -> list[tuple[int, ...]]:
    """Every way in which the three joints of a leg, by their words, may be its hip, thigh and calf."""
    may = [[set(LINK_INDICES[word]) for word in words if word in LINK_INDICES] for words in leg]
    return [
        way
        for way in permutations(range(JOINTS_PER_LEG))
        if all(its and all(str(link) in meant for meant in its) for link, its in zip(way, may, strict=True))
    ]


@cache
def _convention(robot: Robot) -> tuple[Floats, Floats]:
    """Signs and zeros of the robot's joints against those of its model file."""
    if not robot.imported:
        return np.ones(robot.num_joints), np.zeros(robot.num_joints)
    model = robot.user_model.model
    found = robot.user_model.structure
    return found.signs, found.joint_offsets - found.signs * model.qpos0[model.jnt_qposadr[found.joints]]
