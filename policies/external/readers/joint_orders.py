"""Joint orders of known robots, for deployment files that lack the joint names or the joint order.

The joint names are the names in the makers' robot files. Isaac Gym and Isaac Sim import links sorted by name, so that
the legs are in alphabetical order. The joints in Isaac Gym are grouped by leg (`gym.get_asset_dof_names`). The joints
in Isaac Lab with PhysX are in breadth-first order, grouped by kind: hips, thighs, calves (`Articulation.joint_names`).
"""

from collections.abc import Iterable

JointNames = tuple[str, ...]
"""Joint names of a robot, in the order of the joints in a file or a program."""

FAMILIES: dict[str, tuple[str, str]] = {
    "go1 go2 a1 b1 b2 aliengo unitree": ("FL FR RL RR", "hip_joint thigh_joint calf_joint"),
    "anymal": ("LF LH RF RH", "HAA HFE KFE"),
    "spot": ("fl fr hl hr", "hx hy kn"),
    "lite3 deeprobotics": ("FL FR HL HR", "HipX_joint HipY_joint Knee_joint"),
}
"""Robots with equal joint names: words in the path of the robot's model -> leg names, joint kinds.

The words, leg names and joint kinds (hip, thigh, calf) are separated by spaces. A joint name is `LEG_KIND`.
"""


def names_by_leg(legs: str, kinds: str = "hip_joint thigh_joint calf_joint") -> JointNames:
    """Return a robot's joint names, grouped by leg; each leg has its joints from the trunk to the foot.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joint kinds (hip, thigh, calf), separated by spaces.

    Returns:
        Joint names of the form `LEG_KIND`, for example `FL_hip_joint`.
    """
    return tuple(f"{leg}_{kind}" for leg in legs.split() for kind in kinds.split())


def names_by_kind(legs: str, kinds: str) -> JointNames:
    """Return a robot's joint names, grouped by kind; each kind has its joints in the order of the legs.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joint kinds (hip, thigh, calf), separated by spaces.

    Returns:
        Joint names of the form `LEG_KIND`, for example `FL_hip_joint`.
    """
    return tuple(f"{leg}_{kind}" for kind in kinds.split() for leg in legs.split())


def isaac_gym_order(names: Iterable[str]) -> JointNames | None:
    """Return the joint names of a known robot in the order in which Isaac Gym has its joints.

    The legs are in alphabetical order. The joints are grouped by leg, and each leg has its joints from the trunk to the
    foot.

    Args:
        names: All joint names of the robot, in any order.

    Returns:
        The given names in the order of Isaac Gym; None if no known robot (FAMILIES) has exactly these joint names.
    """
    name_set = set(names)
    orders = (names_by_leg(*family) for family in FAMILIES.values())
    return next((order for order in orders if set(order) == name_set), None)


UNITREE_MOTORS = names_by_leg("FR FL RR RL")
"""Joint names of Unitree's quadrupeds in the order of the motors in Unitree's SDK."""
