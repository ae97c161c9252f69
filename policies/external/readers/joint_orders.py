"""Orders of the twelve joints, for files that have no joint names or no order of the joints.

The robots' makers chose the names. Isaac Gym and Isaac Sim import links sorted by name, so that the legs are in
alphabetical order. Isaac Gym's joints are grouped by leg (`gym.get_asset_dof_names`). With PhysX, Isaac Lab's joints
are in breadth-first order, grouped by kind: hips, thighs, calves (`Articulation.joint_names`).
"""

from collections.abc import Iterable

JointNames = tuple[str, ...]

FAMILIES: dict[str, tuple[str, str]] = {
    "go1 go2 a1 b1 b2 aliengo unitree": ("FL FR RL RR", "hip_joint thigh_joint calf_joint"),
    "anymal": ("LF LH RF RH", "HAA HFE KFE"),
    "spot": ("fl fr hl hr", "hx hy kn"),
    "lite3 deeprobotics": ("FL FR HL HR", "HipX_joint HipY_joint Knee_joint"),
}
"""Words in the path of a robot's model -> names of the legs, and names of the joint kinds."""


def names_by_leg(legs: str, kinds: str = "hip_joint thigh_joint calf_joint") -> JointNames:
    """Return joint names grouped by leg; each leg has its joints from the trunk to the foot.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joint kinds, separated by spaces.

    Returns:
        Names of the form `LEG_KIND`.
    """
    return tuple(f"{leg}_{kind}" for leg in legs.split() for kind in kinds.split())


def names_by_kind(legs: str, kinds: str) -> JointNames:
    """Return joint names grouped by kind; each kind has the joints in the order of the legs.

    Args:
        legs: Names of the legs, separated by spaces.
        kinds: Names of the joint kinds, separated by spaces.

    Returns:
        Names of the form `LEG_KIND`.
    """
    return tuple(f"{leg}_{kind}" for kind in kinds.split() for leg in legs.split())


def isaac_gym_order(names: Iterable[str]) -> JointNames | None:
    """Return joint names in Isaac Gym's order; None unless they are the names of a known family."""
    name_set = set(names)
    orders = (names_by_leg(*family) for family in FAMILIES.values())
    return next((order for order in orders if set(order) == name_set), None)


UNITREE_MOTORS = names_by_leg("FR FL RR RL")
"""Joint names in the order of the motors in Unitree's SDK."""
