"""Orders of the twelve joints in the makers' own names, for files without names or without an order.

Isaac Gym and Isaac Sim import links by name: legs are in alphabetical order. Isaac Gym's joints then go leg by leg
(`gym.get_asset_dof_names`), Isaac Lab's, with PhysX, breadth first, so kind by kind (`Articulation.joint_names`).
"""

from collections.abc import Iterable

JointNames = tuple[str, ...]

FAMILIES: dict[str, tuple[str, str]] = {
    "go1 go2 a1 b1 b2 aliengo unitree": ("FL FR RL RR", "hip_joint thigh_joint calf_joint"),
    "anymal": ("LF LH RF RH", "HAA HFE KFE"),
    "spot": ("fl fr hl hr", "hx hy kn"),
    "lite3 deeprobotics": ("FL FR HL HR", "HipX_joint HipY_joint Knee_joint"),
}
"""Words in a model's path, and the legs and kinds in the names of its joints."""


def names_by_leg(legs: str, kinds: str = "hip_joint thigh_joint calf_joint") -> JointNames:
    """Return joint names leg by leg, each from the trunk down.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joints of a leg, separated by spaces.

    Returns:
        Names `LEG_KIND`.
    """
    return tuple(f"{leg}_{kind}" for leg in legs.split() for kind in kinds.split())


def names_by_kind(legs: str, kinds: str) -> JointNames:
    """Return joint names kind by kind, each in the order of the legs.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joints of a leg, separated by spaces.

    Returns:
        Names `LEG_KIND`.
    """
    return tuple(f"{leg}_{kind}" for kind in kinds.split() for leg in legs.split())


def isaac_gym_order(names: Iterable[str]) -> JointNames | None:
    """Return joint names in Isaac Gym's order; None for names of no known family."""
    name_set = set(names)
    orders = (names_by_leg(*family) for family in FAMILIES.values())
    return next((order for order in orders if set(order) == name_set), None)


UNITREE_MOTORS = names_by_leg("FR FL RR RL")
"""Order of the motors in Unitree's SDK."""
