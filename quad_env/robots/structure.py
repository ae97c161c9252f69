"""The legs of a quadruped, found in its compiled model by the tree and the axes, whatever its names and its order.

The robot is the body with the free joint, and all bodies below it. The trunk is that body, or one that is welded to it
and from which all legs hang. A leg is a chain of three hinges below the trunk: the first about the trunk's x axis, the
others about the leg's y axis. `Leg` says what its joints are called, which way they turn and what they read in the
model when they are zero in the terms of `Robot`: legs straight down, hips about +x, thighs and calves about +y.
"""

import re
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from quad_env.robots.feet import (
    LEAST_BENT,
    MOST_BENT,
    SWING,
    Foot,
    body_points_to_world,
    extreme_points,
    find_foot,
    standing_foot,
)
from quad_env.robots.shapes import (
    Bools,
    Floats,
    box_corners,
    descendant_mask,
    geom_ids,
    ground_collision_mask,
    welded_bodies,
)

LEGS, JOINTS_PER_LEG = 4, 3
LINKS = "hip", "thigh", "calf"
LEG_WORDS = {word: words[:2] for words in ("fl lf", "fr rf", "hl rl lh bl", "hr rr rh br") for word in words.split()}
"""Leg by word of a joint's name; only words that mean one leg wherever they are used."""
LINK_WORDS = {"hip": "01", "haa": "0", "abad": "0", "thigh": "1", "hfe": "1", "calf": "2", "knee": "2", "kfe": "2"}
"""Places in the leg that a word may mean, counted from the trunk: some call the thigh's joint a hip too."""
LEAST_BEND = 0.1
"""rad. Least middle of a calf's range that shows the bend direction of its knee."""
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
    joint_offsets: Floats
    """What the joints are, in the robot's terms, where the model has them at `qpos0`, (3,)."""
    hip: Floats
    """Where on the hip's axis its thigh joint is, base frame, (3,)."""
    hip_offset: float
    """Outboard from the hip joint to the plane in which the leg bends."""
    thigh_length: float
    calf_length: float
    foot: Foot
    """Foot with its points in the base frame, the leg straight down."""


@dataclass(frozen=True)
class RobotStructure:
    """What a model's quadruped is made of."""

    root: int
    """Id of the body with the free joint."""
    trunk: int
    """Id of the body from which the legs hang: the root, or one that is welded to it."""
    is_robot_body: Bools
    """Which bodies are the robot's, (nbody,): the root and all below it."""
    collides_with_ground: Bools
    """Which geoms meet the ground, (ngeom,)."""
    body_positions: Floats
    """Of the bodies in the base frame at `qpos0`, (nbody, 3), m."""
    body_rotations: Floats
    """Rotations from the bodies' frames to the base frame at `qpos0`, (nbody, 3, 3)."""
    legs: tuple[Leg, ...]
    """In the order of the model."""
    locked_joints: tuple[str, ...] = ()
    """Names of the joints that belong to no leg and are gone from the model, see `held`."""
    carried_bodies: frozenset[int] = frozenset()
    """Ids of the bodies that these joints would move."""
    omission_lines: tuple[tuple[str, str], ...] = ()
    """Parts of the model that the robot lacks, heading and text of each line, see `omissions`."""

    @property
    def bodies(self) -> list[int]:
        """Ids of the robot's bodies, those that are welded to the trunk among them."""
        return [int(body) for body in np.flatnonzero(self.is_robot_body)]

    @property
    def joints(self) -> list[int]:
        """Ids of the twelve joints, in the order of the model."""
        return [joint for leg in self.legs for joint in leg.joints]

    @cached_property
    def signs(self) -> Floats:
        """Of the axes of the joints, (12,)."""
        return np.concatenate([leg.signs for leg in self.legs])

    @cached_property
    def joint_offsets(self) -> Floats:
        """What the joints are, in the robot's terms, where the model has them at `qpos0`, (12,), rad."""
        return np.concatenate([leg.joint_offsets for leg in self.legs])

    def trunk_collides(self, model: Any) -> bool:
        """Whether the trunk, or a body that is welded to it, meets the ground by itself."""
        return bool(geom_ids(model, self._shell(model), self.collides_with_ground))

    def _shell(self, model: Any) -> list[int]:
        """Ids of the trunk and of what is welded to it in the file: no arm, held as it is."""
        return [body for body in welded_bodies(model, self.trunk) if body not in self.carried_bodies]

    def trunk_box(self, model: Any) -> tuple[Floats, Floats]:
        """Centre and full lengths of the box around the trunk along its own axes, (3,) each, base frame, m.

        Around the geoms of its body that meet the ground, else those of bodies that are welded to it, else those that
        are shown. Raises ModelError where it has none.
        """
        bodies = [self.trunk], self._shell(model)
        found = (geom_ids(model, its, among) for among in (self.collides_with_ground, None) for its in bodies)
        if (shell := next(filter(None, found), None)) is None:
            raise ModelError("the trunk has no geom: nothing shows how large it is")
        placed = ((int(model.geom_bodyid[geom]), box_corners(model, geom)) for geom in shell)
        points = np.concatenate(
            [self.body_positions[body] + is_robot_body @ self.body_rotations[body].T for body, is_robot_body in placed]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        return 0.5 * (low + high), high - low

    def limits(self, model: Any) -> tuple[Floats, Floats]:
        """Lower and upper limits of the joints in the robot's terms, (12,) each, rad; ±π where there are none."""
        apart = model.jnt_range[self.joints] - model.qpos0[model.jnt_qposadr[self.joints]][:, None]
        limits = self.joint_offsets[:, None] + np.sort(self.signs[:, None] * apart, axis=1)
        limits = np.where(model.jnt_limited[self.joints][:, None], limits, (-np.pi, np.pi))
        return limits[:, 0], limits[:, 1]


def detect_structure(mujoco: Any, model: Any) -> RobotStructure:
    """Of a compiled model; `mujoco` is the package. Raises ModelError."""
    root = find_root_body(mujoco, model)
    chains = _chains(mujoco, model, root)
    above = {int(model.body_parentid[body]) for body in chains}
    trunk = above.pop() if len(above) == 1 else root
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    meets = ground_collision_mask(model, root)
    legs = _named([_leg(model, data, trunk, meets, chain) for chain in chains.values()])
    for length in ("hip_offset", "thigh_length", "calf_length", "foot.radius"):
        found = [attrgetter(length)(leg) for leg in legs]
        if np.ptp(found) > _SAME * (legs[0].thigh_length + legs[0].calf_length):
            each = ", ".join(f"{leg.name} {value:.3f}" for leg, value in zip(legs, found, strict=True))
            raise ModelError(f"the legs differ in {re.sub('[_.]', ' ', length)}, m: {each}")
    base = data.xmat[trunk].reshape(3, 3)
    places, axes = (data.xpos - data.xpos[trunk]) @ base, base.T @ data.xmat.reshape(-1, 3, 3)
    return RobotStructure(root, trunk, descendant_mask(model, root), meets, places, axes, legs)


def _name(part: Any) -> str:
    return repr(part.name) if part.name else f"number {part.id}"


def find_root_body(mujoco: Any, model: Any) -> int:
    """Id of the body with the free joint that has most hinges below it: crates and balls of the scene have none. Raises
    ModelError."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not len(free):
        raise ModelError(
            f"the trunk is the body of a free joint; this model has 0 free joints: {_remedy(mujoco, model)}"
        )
    roots = [int(body) for body in model.jnt_bodyid[free]]
    hinges = [int(_joints_below(model, body).sum()) for body in roots]
    if hinges.count(max(hinges)) > 1 and len(roots) > 1:
        names = ", ".join(_name(model.body(body)) for body in roots)
        raise ModelError(f"{len(roots)} bodies have a free joint, and which is the robot is unclear: {names}")
    return roots[int(np.argmax(hinges))]


def _remedy(mujoco: Any, model: Any) -> str:
    """Return the remedy for a model without a free joint: its root is fixed, or moves by joints of its own."""
    firsts = [int(body) for body in np.flatnonzero(model.body_parentid == 0)[1:]]
    counts = {body: int(descendant_mask(model, body)[model.jnt_bodyid].sum()) for body in firsts}
    if not counts or max(counts.values()) == 0:
        return "no body below the world has a joint"
    jointed = [body for body in firsts if counts[body] > 0]
    root = max(jointed, key=lambda body: counts[body])
    if len(jointed) >= LEGS and 2 * counts[root] <= sum(counts.values()):
        return (
            f"{len(jointed)} legs hang from the world, such as {_name(model.body(root))}: put them into a body of the "
            "trunk, with its mass and a <freejoint/>"
        )
    is_robot_body: list[int] = []
    body = root
    while True:  # a planar root may have its joints on several nested bodies
        start = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        is_robot_body += range(start, start + count)
        below = [each for each in np.flatnonzero(model.body_parentid == body) if each != body]
        if not len(below):
            return "no body has four legs below it"
        if len(below) > 1:
            break
        body = int(below[0])
    if not is_robot_body:
        return f"its trunk is fixed: put <freejoint/> into body {_name(model.body(root))}"
    names = ", ".join(_name(model.joint(joint)) for joint in is_robot_body)
    return f"its trunk moves by {names}: put <freejoint/> into body {_name(model.body(body))} in place of these joints"


def _joints_below(model: Any, body: int) -> Bools:
    """Which joints move bodies below that one, (njnt,)."""
    below = descendant_mask(model, body)
    below[body] = False
    return np.asarray(below[model.jnt_bodyid])


def find_branches(model: Any, trunk: int) -> dict[int, list[int]]:
    """First body of each branch, below the trunk or what is welded to it -> its joints, the first of them first."""
    found: dict[int, list[int]] = {}
    fixed = welded_bodies(model, trunk)
    for joint in np.flatnonzero(_joints_below(model, trunk)):
        first = int(model.jnt_bodyid[joint])
        while model.body_parentid[first] not in fixed:
            first = int(model.body_parentid[first])
        found.setdefault(first, []).append(int(joint))
    return found


def _chains(mujoco: Any, model: Any, trunk: int) -> dict[int, list[int]]:
    """First body of each leg, below the trunk or what is welded to it -> its joints, hip first."""
    chains = find_branches(model, trunk)
    joints = [joint for chain in chains.values() for joint in chain]
    if others := [joint for joint in joints if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE]:
        raise ModelError(f"joint {_name(model.joint(others[0]))} is no hinge")
    if len(joints) != LEGS * JOINTS_PER_LEG or len(chains) != LEGS:
        counts = ", ".join(f"{len(chain)} below {_name(model.body(root))}" for root, chain in chains.items())
        raise ModelError(
            f"four legs of three hinges are wanted; this model has {len(joints)} hinges: {counts or 'none'}"
        )
    if nameless := [joint for joint in joints if not model.joint(joint).name]:
        raise ModelError(f"joints are identified by their names; number {nameless[0]} of this model has none")
    for root, chain in chains.items():
        bodies = [int(model.jnt_bodyid[joint]) for joint in chain]
        pairs = zip(bodies, (trunk, *bodies), strict=False)
        if len(chain) != JOINTS_PER_LEG or not all(a != b and descendant_mask(model, b)[a] for a, b in pairs):
            raise ModelError(f"the joints below {_name(model.body(root))} are no chain of three hinges")
    return chains


def is_hip_axis(axis: Floats) -> bool:
    """Whether a hinge about an axis, (3,), of the base frame is that of a hip: about the trunk's x axis."""
    return bool(abs(axis[0]) >= _PARALLEL)


def are_lateral_axes(thigh: Floats, calf: Floats) -> bool:
    """Whether hinges about these axes, (3,) each, of the base frame are those of a thigh and its calf: parallel, and
    across the trunk's x axis."""
    return bool(abs(thigh @ calf) >= _PARALLEL and abs(thigh[0]) <= 1.0 - _PARALLEL)


def _leg(model: Any, data: Any, trunk: int, meets: Bools, chain: list[int]) -> Leg:
    base, origin = data.xmat[trunk].reshape(3, 3), data.xpos[trunk]
    hip, thigh, knee = ((data.xanchor[joint] - origin) @ base for joint in chain)
    axes = [data.xaxis[joint] @ base for joint in chain]
    names = [_name(model.joint(joint)) for joint in chain]
    if not is_hip_axis(axes[0]):
        raise ModelError(f"joint {names[0]}, the hip, turns about {_rounded(axes[0])}, not about the trunk's x axis")
    if not are_lateral_axes(axes[1], axes[2]) or axes[1][1] == 0.0:
        raise ModelError(
            f"joints {names[1]} and {names[2]} turn about {_rounded(axes[1])} and {_rounded(axes[2])}, "
            "not both about the leg's y axis"
        )
    signs = np.array([np.sign(axes[0][0]), np.sign(axes[1][1]), np.sign(axes[2] @ axes[1]) * np.sign(axes[1][1])])
    lateral = signs[1] * axes[1]
    leg = np.stack(((1.0, 0.0, 0.0), lateral, np.cross((1.0, 0.0, 0.0), lateral)))
    shin = int(model.jnt_bodyid[chain[-1]])
    candidates = geom_ids(model, welded_bodies(model, shin), meets)
    if not candidates:
        raise ModelError(f"below joint {names[2]} nothing collides with the ground: no foot")
    sole = find_foot(model, data, chain[-1], candidates)
    if sole is None:
        geom = _name(model.geom(candidates[-1]))
        raise ModelError(
            f"all that collides below joint {names[2]} lies at the joint: give geom {geom}, the foot, a pos"
        )
    at = (body_points_to_world(data, sole.body, sole.centre) - origin) @ base
    across, upper, lower = leg @ (thigh - hip), leg @ (knee - thigh), leg @ (at - knee)
    lengths = [float(np.hypot(link[0], link[2])) for link in (upper, lower)]
    if min(lengths) < 1e-3:
        raise ModelError(f"a link below joint {names[1]} has no length")
    if abs(across[2]) > _SAME * sum(lengths):
        raise ModelError(f"joint {names[1]} lies {across[2]:+.3f} m off the height of the hip's axis in its leg")
    turned, bent = (float(np.arctan2(-link[0], -link[2])) for link in (upper, lower))
    zeros = np.array([np.arctan2(lateral[2], lateral[1]), turned, bent - turned])
    zeros = np.arctan2(np.sin(zeros), np.cos(zeros))
    side = float(across[1] + upper[1] + lower[1])
    sole = standing_foot(model, data, chain[-1], candidates, sole, _tilts(model, chain, signs, zeros))
    turn = data.xmat[sole.body].reshape(3, 3)
    sin, cos = np.sin(bent), np.cos(bent)
    straightened = np.array(((cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos))).T
    points, radii = extreme_points(sole.points @ (straightened @ leg @ base.T @ turn).T, sole.radii)
    return Leg(
        name="",
        joints=(chain[0], chain[1], chain[2]),
        signs=signs,
        joint_offsets=zeros,
        hip=hip + across[0] * np.array((1.0, 0.0, 0.0)),
        hip_offset=side,
        thigh_length=lengths[0],
        calf_length=lengths[1],
        foot=sole._replace(points=points, radii=radii),
    )


def _tilts(model: Any, chain: list[int], signs: Floats, zeros: Floats) -> tuple[float, float]:
    """Return the least and largest tilt of a shin about its knee axis in a stance, from the leg straight down, rad."""
    places = model.jnt_qposadr[chain]
    angles = zeros + signs * (model.key_qpos[:, places] - model.qpos0[places])
    standing = float(np.abs(angles[:, 1] + angles[:, 2]).max()) if model.nkey else 0.0
    bent = float(np.clip(standing + SWING, LEAST_BENT, MOST_BENT))
    bend = signs[2] * bend_direction(model, chain[2], float(signs[2]), float(zeros[2]))
    return (-bent if bend <= 0.0 else -SWING), (bent if bend >= 0.0 else SWING)


def bend_direction(model: Any, joint: int, sign: float, zero: float) -> float:
    """Return the bend direction of a knee by its joint limits: -1 backward, 1 forward, 0 if both are possible.

    Args:
        model: Compiled model.
        joint: Id of the calf's joint.
        sign: Of its axis, see `Leg.signs`.
        zero: Its angle in the robot's terms at `qpos0`, rad.
    """
    if not model.jnt_limited[joint]:
        return 0.0
    middle = zero + sign * float(model.jnt_range[joint].mean() - model.qpos0[model.jnt_qposadr[joint]])
    return float(np.sign(middle)) if abs(middle) > LEAST_BEND else 0.0


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
        places = ", ".join(str(_rounded(leg.hip)) for leg in named)
        raise ModelError(f"hips are wanted at four corners about the origin of the trunk; they are at {places} m")
    return named


def _rounded(axis: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in np.round(axis, 2) + 0.0)
