"""The legs of a quadruped, found in its compiled model by the tree and the axes, whatever its names and its order.

A leg is a chain of three hinges below the trunk, the body of the only free joint: the first about the trunk's x axis,
the others about the leg's y axis. `Leg` says what its joints are called, which way they turn and what they read in the
model when they are zero in the terms of `Robot`: legs straight down, hips about +x, thighs and calves about +y.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEGS, JOINTS_PER_LEG = 4, 3
_PARALLEL = 0.999
"""Least cosine of two axes that are taken for parallel."""
_SAME = 0.02
"""Largest difference between the legs of a robot in a length, as a share of a leg's."""


class ModelError(ValueError):
    """A model that is no quadruped of this kind; its text says in a line what is wrong."""


@dataclass(frozen=True)
class Leg:
    """A leg; lengths in m, angles in rad."""

    name: str
    """By where its hip is: fl, fr, hl or hr."""
    joints: tuple[int, int, int]
    """Ids of hip, thigh and calf in the model."""
    signs: Floats
    """Of the model's axes, (3,)."""
    zeros: Floats
    """What the joints are, in the robot's terms, where the model has them at `qpos0`, (3,)."""
    hip: Floats
    """Where on the hip's axis its thigh joint is, base frame, (3,)."""
    hip_offset: float
    """Outboard from the hip joint to the plane in which the leg bends."""
    thigh_length: float
    calf_length: float
    foot: int
    """Id of the geom that is the foot."""
    foot_place: Floats
    """Its centre in the frame of its body, (3,)."""
    foot_radius: float


@dataclass(frozen=True)
class Anatomy:
    """What a model's quadruped is made of."""

    trunk: int
    """Id of its body."""
    legs: tuple[Leg, ...]
    """In the order of the model."""

    @property
    def joints(self) -> list[int]:
        """Ids of the twelve joints, in the order of the model."""
        return [joint for leg in self.legs for joint in leg.joints]

    @cached_property
    def signs(self) -> Floats:
        """Of the axes of the joints, (12,)."""
        return np.concatenate([leg.signs for leg in self.legs])

    @cached_property
    def zeros(self) -> Floats:
        """What the joints are, in the robot's terms, where the model has them at `qpos0`, (12,), rad."""
        return np.concatenate([leg.zeros for leg in self.legs])

    def limits(self, model: Any) -> tuple[Floats, Floats]:
        """Lower and upper limits of the joints in the robot's terms, (12,) each, rad; ±π where there are none."""
        apart = model.jnt_range[self.joints] - model.qpos0[model.jnt_qposadr[self.joints]][:, None]
        limits = self.zeros[:, None] + np.sort(self.signs[:, None] * apart, axis=1)
        limits = np.where(model.jnt_limited[self.joints][:, None], limits, (-np.pi, np.pi))
        return limits[:, 0], limits[:, 1]


def anatomy(mujoco: Any, model: Any) -> Anatomy:
    """Of a compiled model; `mujoco` is the package. Raises ModelError."""
    trunk = _trunk(mujoco, model)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    legs = _named([_leg(mujoco, model, data, trunk, chain) for chain in _chains(mujoco, model, trunk)])
    for length in ("hip_offset", "thigh_length", "calf_length", "foot_radius"):
        found = [getattr(leg, length) for leg in legs]
        if np.ptp(found) > _SAME * (legs[0].thigh_length + legs[0].calf_length):
            told = ", ".join(f"{leg.name} {value:.3f}" for leg, value in zip(legs, found, strict=True))
            raise ModelError(f"the legs differ in {length.replace('_', ' ')}, m: {told}")
    return Anatomy(trunk, legs)


def _name(part: Any) -> str:
    return repr(part.name) if part.name else f"number {part.id}"


def _trunk(mujoco: Any, model: Any) -> int:
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if len(free) != 1:
        raise ModelError(f"the trunk is the body of the only free joint; this model has {len(free)} free joints")
    return int(model.jnt_bodyid[free[0]])


def _chains(mujoco: Any, model: Any, trunk: int) -> list[list[int]]:
    """Joints of each leg, hip first."""
    chains: dict[int, list[int]] = {}
    for joint in range(model.njnt):
        if (body := int(model.jnt_bodyid[joint])) == trunk:
            continue
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            raise ModelError(f"joint {_name(model.joint(joint))} is no hinge")
        root = body
        while model.body_parentid[root] not in (0, trunk):
            root = int(model.body_parentid[root])
        if model.body_parentid[root] != trunk:
            raise ModelError(f"joint {_name(model.joint(joint))} is not below the trunk")
        chains.setdefault(root, []).append(joint)
    if nameless := [joint for chain in chains.values() for joint in chain if not model.joint(joint).name]:
        raise ModelError(f"joints are told apart by their names; number {nameless[0]} of this model has none")
    count = sum(map(len, chains.values()))
    if count != LEGS * JOINTS_PER_LEG or len(chains) != LEGS:
        told = ", ".join(f"{len(c)} below {_name(model.body(root))}" for root, c in chains.items())
        raise ModelError(f"four legs of three hinges are wanted; this model has {count} hinges: {told or 'none'}")
    for root, chain in chains.items():
        bodies = [int(model.jnt_bodyid[joint]) for joint in chain]
        pairs = zip(bodies, (trunk, *bodies), strict=False)
        if len(chain) != JOINTS_PER_LEG or not all(_below(model, *pair) for pair in pairs):
            raise ModelError(f"the joints below {_name(model.body(root))} are no chain of three hinges")
    return list(chains.values())


def _below(model: Any, body: int, ancestor: int) -> bool:
    while (body := int(model.body_parentid[body])) > 0:
        if body == ancestor:
            return True
    return False


def _leg(mujoco: Any, model: Any, data: Any, trunk: int, chain: list[int]) -> Leg:
    base, origin = data.xmat[trunk].reshape(3, 3), data.xpos[trunk]
    hip, thigh, knee = ((data.xanchor[joint] - origin) @ base for joint in chain)
    axes = [data.xaxis[joint] @ base for joint in chain]
    told = [_name(model.joint(joint)) for joint in chain]
    if abs(axes[0][0]) < _PARALLEL:
        raise ModelError(f"joint {told[0]}, the hip, turns about {_rounded(axes[0])}, not about the trunk's x axis")
    if abs(axes[1] @ axes[2]) < _PARALLEL or abs(axes[1][0]) > 1.0 - _PARALLEL or axes[1][1] == 0.0:
        raise ModelError(
            f"joints {told[1]} and {told[2]} turn about {_rounded(axes[1])} and {_rounded(axes[2])}, "
            "not both about the leg's y axis"
        )
    signs = np.array([np.sign(axes[0][0]), np.sign(axes[1][1]), np.sign(axes[2] @ axes[1]) * np.sign(axes[1][1])])
    lateral = signs[1] * axes[1]
    leg = np.stack(((1.0, 0.0, 0.0), lateral, np.cross((1.0, 0.0, 0.0), lateral)))
    geom, place, radius = _foot(mujoco, model, data, chain[-1])
    sole = int(model.geom_bodyid[geom])
    foot = (data.xpos[sole] + data.xmat[sole].reshape(3, 3) @ place - origin) @ base
    across, upper, lower = leg @ (thigh - hip), leg @ (knee - thigh), leg @ (foot - knee)
    lengths = [float(np.hypot(link[0], link[2])) for link in (upper, lower)]
    if min(lengths) < 1e-3:
        raise ModelError(f"a link below joint {told[1]} has no length")
    if abs(across[2]) > _SAME * sum(lengths):
        raise ModelError(f"joint {told[1]} lies {across[2]:+.3f} m beside the height of the hip's axis in its leg")
    turned, shin = (float(np.arctan2(-link[0], -link[2])) for link in (upper, lower))
    zeros = np.array([np.arctan2(lateral[2], lateral[1]), turned, shin - turned])
    side = float(across[1] + upper[1] + lower[1])
    return Leg(
        name="",
        joints=(chain[0], chain[1], chain[2]),
        signs=signs,
        zeros=np.arctan2(np.sin(zeros), np.cos(zeros)),
        hip=hip + across[0] * np.array((1.0, 0.0, 0.0)),
        hip_offset=side,
        thigh_length=lengths[0],
        calf_length=lengths[1],
        foot=geom,
        foot_place=place,
        foot_radius=radius,
    )


def _named(legs: list[Leg]) -> tuple[Leg, ...]:
    """The legs with their names and their offsets outboard."""
    ahead, left = np.array([leg.hip[:2] for leg in legs]).T
    named = tuple(
        replace(
            leg,
            name=("f" if leg.hip[0] > ahead.mean() else "h") + ("l" if leg.hip[1] > left.mean() else "r"),
            hip_offset=leg.hip_offset if leg.hip[1] > left.mean() else -leg.hip_offset,
        )
        for leg in legs
    )
    between = all(
        (leg.hip[0] > 0) == (leg.name[0] == "f") and (leg.hip[1] > 0) == (leg.name[1] == "l") for leg in named
    )
    if len({leg.name for leg in named}) < LEGS or not between:
        told = ", ".join(str(_rounded(leg.hip)) for leg in named)
        raise ModelError(f"hips are wanted at four corners about the origin of the trunk; they are at {told} m")
    return named


def _rounded(axis: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in np.round(axis, 2) + 0.0)


def _foot(mujoco: Any, model: Any, data: Any, knee: int) -> tuple[int, Floats, float]:
    """The geom below the knee that collides and reaches farthest, where its ball is in its body, and its radius."""
    shin = int(model.jnt_bodyid[knee])
    best: tuple[float, int, Floats, float] | None = None
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if not (body == shin or _below(model, body, shin)) or geom not in colliding(model, body):
            continue
        for place, radius in _balls(mujoco, model, geom):
            at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ place
            if best is None or np.linalg.norm(at - data.xanchor[knee]) + radius > best[0]:
                best = float(np.linalg.norm(at - data.xanchor[knee])) + radius, geom, place, radius
    if best is None:
        raise ModelError(f"below joint {_name(model.joint(knee))} no sphere or capsule collides: no foot")
    return best[1:]


def _balls(mujoco: Any, model: Any, geom: int) -> list[tuple[Floats, float]]:
    """Ends of a sphere or capsule in the frame of its body, m, with their radius."""
    kind, (radius, half), place = model.geom_type[geom], model.geom_size[geom, :2], model.geom_pos[geom].copy()
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return [(place, float(radius))]
    if kind != mujoco.mjtGeom.mjGEOM_CAPSULE:
        return []
    along = np.zeros(9)
    mujoco.mju_quat2Mat(along, model.geom_quat[geom])
    return [(place + sign * half * along.reshape(3, 3)[:, 2], float(radius)) for sign in (1.0, -1.0)]


def colliding(model: Any, body: int) -> list[int]:
    """Ids of a body's geoms that do."""
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    return [int(geom) for geom in np.flatnonzero((model.geom_bodyid == body) & collides)]
