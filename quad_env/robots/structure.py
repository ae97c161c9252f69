"""Detection of the trunk and the legs of a user's robot in its compiled model.

The detection uses the kinematic tree and the joint axes, but not the names and the order of bodies and joints. The
robot is the body with the free joint, and all bodies below it. The trunk is the body from which all legs hang: the body
with the free joint, or a body welded to it. A leg is a chain of three hinges below the trunk: the first about the
trunk's x axis, the others about the leg's y axis.

This package measures joint angles from the pose with the legs straight down; hips turn about +x, thighs and calves
about +y. The signs and offsets in `Leg` convert the joint angles of the user's model to these angles.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.feet import (
    STANCE_TILTS,
    Foot,
    body_points_to_world,
    extend_foot,
    extreme_points,
    find_foot,
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

LEGS = 4
"""Number of legs of a robot."""
JOINTS_PER_LEG = 3
"""Number of joints of a leg: hip, thigh and calf."""
LINKS = ("hip", "thigh", "calf")
"""Names of the links of a leg, and of the joints that move them, from the trunk to the foot."""
LEG_WORDS = {word: words[:2] for words in ("fl lf", "fr rf", "hl rl lh bl", "hr rr rh br") for word in words.split()}
"""Word of a joint's name -> the leg that the word means: fl, fr, hl or hr (front or hind, left or right).

The dictionary contains only words that mean the same leg in all models.
"""
LINK_WORDS = {"hip": "01", "haa": "0", "abad": "0", "thigh": "1", "hfe": "1", "calf": "2", "knee": "2", "kfe": "2"}
"""Word of a joint's name -> digits of the joints that the word can mean: 0 for hip, 1 for thigh, 2 for calf.

The word `hip` has two digits, because some makers use it for the thigh joint, too.
"""
MIN_BEND_ANGLE = 0.1
"""Smallest magnitude of a calf angle at which its sign shows the direction in which the knee bends, rad.

The calf angle is the middle between the limits of the calf joint; it is zero with a straight leg.
"""
_PARALLEL_COSINE = 0.999
"""Smallest cosine of the angle between two joint axes at which the axes are considered parallel."""
_LENGTH_TOLERANCE = 0.02
"""Largest valid difference between the dimensions of a robot's legs, as a fraction of the leg length.

The difference is limited because the controllers use the same dimensions for all legs.
"""
_MIN_LINK_LENGTH = 1e-3
"""Smallest valid length of a thigh or a calf, m; a shorter length shows an error of the model."""


class ModelError(ValueError):
    """Error that is raised if a user's model cannot be used as a quadruped; the message is one line."""


@dataclass(frozen=True)
class Leg:
    """Joints, lengths and foot of a leg in a compiled model; made by `detect_structure`."""

    name: str
    """Name of the leg by the position of its hip: fl, fr, hl or hr (f: front, h: hind, l: left, r: right)."""
    joints: tuple[int, int, int]
    """Ids of the hip, thigh and calf joints in the compiled model."""
    signs: Floats
    """Direction of the hip, thigh and calf axes in the model, (3,).

    Each number is +1 if the hip turns about +x, or the thigh or calf about +y, and -1 for the opposite direction.
    """
    joint_offsets: Floats
    """Hip, thigh and calf angles in the pose `qpos0`, measured from the leg straight down, (3,), rad."""
    hip: Floats
    """Position of the hip joint, base frame, (3,), m.

    This position is the point on the axis of the hip joint that has the same x coordinate as the thigh joint.
    """
    hip_offset: float
    """Lateral distance from the hip joint to the plane in which the leg bends, positive outward, m."""
    thigh_length: float
    """Distance from the thigh joint to the calf joint, m."""
    calf_length: float
    """Distance from the calf joint to the centre of the foot, m."""
    foot: Foot
    """Geoms and shape of the foot; its points are in the base frame with the leg straight down."""


@dataclass(frozen=True)
class RobotStructure:
    """Trunk, legs and colliding geoms of a user's robot in its compiled model; made by `detect_structure`."""

    root: int
    """Id of the robot's root body, which has the free joint, in the compiled model."""
    trunk: int
    """Id of the body from which the legs hang: the root body, or a body welded to it."""
    is_robot_body: Bools
    """Mask that is True for the robot's bodies: the root body and all bodies below it, (nbody,)."""
    collides_with_ground: Bools
    """Mask that is True for the robot's geoms that collide with the ground, (ngeom,)."""
    body_positions: Floats
    """Positions of all bodies of the model in the pose `qpos0`, base frame, (nbody, 3), m."""
    body_rotations: Floats
    """Rotations from the frames of all bodies to the base frame in the pose `qpos0`, (nbody, 3, 3)."""
    legs: tuple[Leg, ...]
    """The four legs, in the order of their joints in the model."""
    locked_joints: tuple[str, ...] = ()
    """Names of the joints that belong to no leg, such as joints of an arm; they were removed from the model."""
    carried_bodies: frozenset[int] = frozenset()
    """Ids of the bodies that the locked joints moved before these joints were removed."""
    omission_lines: tuple[tuple[str, str], ...] = ()
    """Report to the user about the parts of the file that the robot lacks: heading and text of each line."""

    @property
    def bodies(self) -> list[int]:
        """Ids of all bodies of the robot in the compiled model, in ascending order."""
        return [int(body) for body in np.flatnonzero(self.is_robot_body)]

    @property
    def joints(self) -> list[int]:
        """Ids of the twelve leg joints in the compiled model: hip, thigh and calf of each leg of `legs`."""
        return [joint for leg in self.legs for joint in leg.joints]

    @cached_property
    def signs(self) -> Floats:
        """Directions of the leg joints' axes in the model, (12,).

        Each number is +1 if a hip turns about +x, or a thigh or calf about +y, and -1 for the opposite direction.
        """
        return np.concatenate([leg.signs for leg in self.legs])

    @cached_property
    def joint_offsets(self) -> Floats:
        """Leg joint angles in the pose `qpos0` of the model, measured from straight legs, (12,), rad."""
        return np.concatenate([leg.joint_offsets for leg in self.legs])

    def trunk_collides(self, model: Any) -> bool:
        """Return True if the trunk, or a body welded to the trunk in the file, collides with the ground.

        Args:
            model: Compiled `mujoco.MjModel` with this structure.

        Returns:
            False if no geom of these bodies collides with the ground.
        """
        return bool(geom_ids(model, self._trunk_bodies(model), self.collides_with_ground))

    def _trunk_bodies(self, model: Any) -> list[int]:
        """Return the ids of the trunk and of the bodies that are welded to it in the user's file.

        Bodies that are welded to the trunk only because their joint was locked, such as an arm, are left out.
        """
        return [body for body in welded_bodies(model, self.trunk) if body not in self.carried_bodies]

    def trunk_box(self, model: Any) -> tuple[Floats, Floats]:
        """Compute the bounding box of the trunk, aligned with the axes of the base frame.

        The box encloses the first set of geoms in this list that is not empty:
        1. the trunk's geoms that collide with the ground,
        2. the geoms that collide with the ground, of the trunk and the bodies welded to it,
        3. all geoms of the trunk,
        4. all geoms of the trunk and the bodies welded to it.

        Args:
            model: Compiled `mujoco.MjModel` with this structure.

        Returns:
            centre: Centre of the box, base frame, (3,), m.
            size: Full lengths of the box along x, y and z, (3,), m.

        Raises:
            ModelError: The trunk has no geom.
        """
        candidates = (
            geom_ids(model, bodies, among)
            for among in (self.collides_with_ground, None)
            for bodies in ([self.trunk], self._trunk_bodies(model))
        )
        if (geoms := next(filter(None, candidates), None)) is None:
            raise ModelError("the trunk has no geom: nothing shows how large it is")
        corners = []
        for geom in geoms:
            body = int(model.geom_bodyid[geom])
            corners.append(self.body_positions[body] + box_corners(model, geom) @ self.body_rotations[body].T)
        points = np.concatenate(corners)
        low = points.min(axis=0)
        high = points.max(axis=0)
        return 0.5 * (low + high), high - low

    def limits(self, model: Any) -> tuple[Floats, Floats]:
        """Return the limits of the leg joints, measured from straight legs; ±π for joints without limits.

        Args:
            model: Compiled `mujoco.MjModel` with this structure.

        Returns:
            lower: Lower limits, (12,), rad.
            upper: Upper limits, (12,), rad.
        """
        apart = model.jnt_range[self.joints] - model.qpos0[model.jnt_qposadr[self.joints]][:, None]
        limits = self.joint_offsets[:, None] + np.sort(self.signs[:, None] * apart, axis=1)
        limits = np.where(model.jnt_limited[self.joints][:, None], limits, (-np.pi, np.pi))
        return limits[:, 0], limits[:, 1]


def detect_structure(mujoco: Any, model: Any) -> RobotStructure:
    """Detect trunk and legs of a quadruped in a compiled model.

    A model that is not a quadruped with four legs of three hinges raises ModelError.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.

    Returns:
        Trunk, legs and colliding geoms. `locked_joints`, `carried_bodies` and `omission_lines` are empty.
    """
    root = find_root_body(mujoco, model)
    chains = _find_chains(mujoco, model, root)
    parents = {int(model.body_parentid[body]) for body in chains}
    trunk = parents.pop() if len(parents) == 1 else root
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    collides = ground_collision_mask(model, root)
    legs = _name_legs([_measure_leg(model, data, trunk, collides, chain) for chain in chains.values()])
    _check_equal_legs(legs)
    base = data.xmat[trunk].reshape(3, 3)
    positions = (data.xpos - data.xpos[trunk]) @ base
    rotations = base.T @ data.xmat.reshape(-1, 3, 3)
    return RobotStructure(root, trunk, descendant_mask(model, root), collides, positions, rotations, legs)


def _check_equal_legs(legs: Sequence[Leg]) -> None:
    """Raise ModelError if the legs differ in hip offset, thigh length, calf length or foot radius."""
    for length in ("hip_offset", "thigh_length", "calf_length", "foot.radius"):
        values = [attrgetter(length)(leg) for leg in legs]
        if np.ptp(values) > _LENGTH_TOLERANCE * (legs[0].thigh_length + legs[0].calf_length):
            lengths = ", ".join(f"{leg.name} {value:.3f}" for leg, value in zip(legs, values, strict=True))
            raise ModelError(f"the legs differ in {re.sub('[_.]', ' ', length)}, m: {lengths}")


def _name(part: Any) -> str:
    return repr(part.name) if part.name else f"number {part.id}"


def find_root_body(mujoco: Any, model: Any) -> int:
    """Find the robot's root body: among the bodies with a free joint, the one with most joints below it.

    Other objects with a free joint, such as crates and balls, have no joints below them.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.

    Returns:
        Id of the root body.

    Raises:
        ModelError: There is no free joint, or several bodies with a free joint have the same number of joints.
    """
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not len(free):
        raise ModelError(
            f"the trunk is the body of a free joint; this model has 0 free joints: {_free_joint_remedy(model)}"
        )
    roots = [int(body) for body in model.jnt_bodyid[free]]
    hinges = [int(_joints_below(model, body).sum()) for body in roots]
    if hinges.count(max(hinges)) > 1 and len(roots) > 1:
        names = ", ".join(_name(model.body(body)) for body in roots)
        raise ModelError(f"{len(roots)} bodies have a free joint, and which is the robot is unclear: {names}")
    return roots[int(np.argmax(hinges))]


def _free_joint_remedy(model: Any) -> str:
    """Return the remedy for a model without a free joint, for the error message.

    The remedy depends on the fault of the model. There are three cases: the trunk is fixed to the world, the trunk has
    other joints than a free joint (three slides of a planar robot, for example), or the legs hang from the world.
    """
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
    root_joints: list[int] = []
    body = root
    while True:  # The joints that move a planar trunk may belong to several nested bodies.
        start = int(model.body_jntadr[body])
        root_joints += range(start, start + int(model.body_jntnum[body]))
        below = [each for each in np.flatnonzero(model.body_parentid == body) if each != body]
        if not len(below):
            return "no body has four legs below it"
        if len(below) > 1:
            break
        body = int(below[0])
    if not root_joints:
        return f"its trunk is fixed: put <freejoint/> into body {_name(model.body(root))}"
    names = ", ".join(_name(model.joint(joint)) for joint in root_joints)
    return f"its trunk moves by {names}: put <freejoint/> into body {_name(model.body(body))} in place of these joints"


def _joints_below(model: Any, body: int) -> Bools:
    """Return a mask, (njnt,), that is True for the joints of all bodies below the body `body` in `model`.

    The joints of `body` itself are excluded.
    """
    below = descendant_mask(model, body)
    below[body] = False
    return np.asarray(below[model.jnt_bodyid])


def find_branches(model: Any, trunk: int) -> dict[int, list[int]]:
    """Find the branches of the kinematic tree that start at the trunk or at a body welded to the trunk.

    Each leg is a branch. An arm or a head with joints is a branch, too.

    Args:
        model: Compiled `mujoco.MjModel`.
        trunk: Id of the trunk's body.

    Returns:
        Id of the first body of a branch -> ids of all joints in this branch, in the order of the model.
    """
    branches: dict[int, list[int]] = {}
    fixed = welded_bodies(model, trunk)
    for joint in np.flatnonzero(_joints_below(model, trunk)):
        first = int(model.jnt_bodyid[joint])
        while model.body_parentid[first] not in fixed:
            first = int(model.body_parentid[first])
        branches.setdefault(first, []).append(int(joint))
    return branches


def _find_chains(mujoco: Any, model: Any, trunk: int) -> dict[int, list[int]]:
    """Find the four legs below the trunk as chains of three hinges.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.
        trunk: Id of the trunk's body.

    Returns:
        Id of the first body of a leg -> ids of its three hinges, hip first.

    Raises:
        ModelError: The branches below the trunk are not four chains of three hinges with names.
    """
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
    """Return True if a joint axis is parallel to the trunk's x axis, as the axis of a hip joint must be.

    `axis` is a unit vector in the base frame, (3,).
    """
    return bool(abs(axis[0]) >= _PARALLEL_COSINE)


def are_lateral_axes(thigh: Floats, calf: Floats) -> bool:
    """Return True if two joint axes are parallel and perpendicular to x, as thigh and calf axes must be.

    Args:
        thigh: Axis of the thigh joint, unit vector, base frame, (3,).
        calf: Axis of the calf joint, unit vector, base frame, (3,).

    Returns:
        True if both conditions hold.
    """
    return bool(abs(thigh @ calf) >= _PARALLEL_COSINE and abs(thigh[0]) <= 1.0 - _PARALLEL_COSINE)


class _Chain(NamedTuple):
    """Positions and axes of the hip, thigh and calf joints of a leg in the pose `qpos0`; made by `_read_chain`."""

    joints: list[int]
    """Ids of the hip, thigh and calf joints in the compiled model."""
    names: list[str]
    """Names of the hip, thigh and calf joints, quoted for error messages."""
    anchors: list[Floats]
    """Positions of the hip, thigh and calf joints, base frame, (3,) each, m."""
    axes: list[Floats]
    """Unit vectors of the hip, thigh and calf axes, base frame, (3,) each."""
    signs: Floats
    """Directions of the hip, thigh and calf axes, (3,).

    Each number is +1 if the hip turns about +x, or the thigh or calf about +y, and -1 for the opposite direction.
    """
    leg_rotation: Floats
    """Rotation from the base frame to the leg frame, (3, 3): x forward, y along the thigh's axis to the left."""


class _LegVectors(NamedTuple):
    """Vectors between the joints and the foot of a leg in the pose `qpos0`.

    The vectors are in the leg frame: x forward, y along the thigh's axis to the left.
    """

    hip_to_thigh: Floats
    """Vector from the hip joint to the thigh joint, leg frame, (3,), m."""
    thigh_to_knee: Floats
    """Vector from the thigh joint to the calf joint, leg frame, (3,), m."""
    knee_to_foot: Floats
    """Vector from the calf joint to the centre of the foot, leg frame, (3,), m."""

    @property
    def lengths(self) -> list[float]:
        """Length of the thigh, then length of the calf, in the plane in which the leg bends, m."""
        return [float(np.hypot(link[0], link[2])) for link in (self.thigh_to_knee, self.knee_to_foot)]

    @property
    def pitches(self) -> tuple[float, float]:
        """Pitch angle of the thigh, then of the calf, about the leg's y axis, zero for straight down, rad."""
        thigh, calf = (float(np.arctan2(-link[0], -link[2])) for link in (self.thigh_to_knee, self.knee_to_foot))
        return thigh, calf


def _read_chain(model: Any, data: Any, trunk: int, joints: list[int]) -> _Chain:
    """Read the positions and axes of a leg's joints in the pose `qpos0`.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        trunk: Id of the trunk's body.
        joints: Ids of the hip, thigh and calf joints.

    Returns:
        The joints of the leg.

    Raises:
        ModelError: The hip does not turn about x, or thigh and calf do not both turn about the leg's y axis.
    """
    base = data.xmat[trunk].reshape(3, 3)
    anchors = [(data.xanchor[joint] - data.xpos[trunk]) @ base for joint in joints]
    hip, thigh, calf = (data.xaxis[joint] @ base for joint in joints)
    names = [_name(model.joint(joint)) for joint in joints]
    if not is_hip_axis(hip):
        raise ModelError(f"joint {names[0]}, the hip, turns about {_rounded(hip)}, not about the trunk's x axis")
    if not are_lateral_axes(thigh, calf) or thigh[1] == 0.0:
        raise ModelError(
            f"joints {names[1]} and {names[2]} turn about {_rounded(thigh)} and {_rounded(calf)}, "
            "not both about the leg's y axis"
        )
    signs = np.array([np.sign(hip[0]), np.sign(thigh[1]), np.sign(calf @ thigh) * np.sign(thigh[1])])
    lateral = signs[1] * thigh
    leg_rotation = np.stack(((1.0, 0.0, 0.0), lateral, np.cross((1.0, 0.0, 0.0), lateral)))
    return _Chain(joints, names, anchors, [hip, thigh, calf], signs, leg_rotation)


def _find_sole(model: Any, data: Any, chain: _Chain, collides: Bools) -> tuple[Foot, list[int]]:
    """Find the foot of a leg: the colliding geoms that are lowest if the leg points straight down.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        chain: Joints of the leg.
        collides: Mask of the geoms that collide with the ground, (ngeom,).

    Returns:
        foot: The foot, which consists of the lowest geoms of the leg's last link.
        candidates: Ids of all geoms of the leg's last link that collide with the ground.

    Raises:
        ModelError: No geom of the last link collides with the ground, or all of these geoms lie at the knee.
    """
    knee = chain.joints[-1]
    candidates = geom_ids(model, welded_bodies(model, int(model.jnt_bodyid[knee])), collides)
    if not candidates:
        raise ModelError(f"below joint {chain.names[2]} nothing collides with the ground: no foot")
    foot = find_foot(model, data, knee, candidates)
    if foot is None:
        geom = _name(model.geom(candidates[-1]))
        raise ModelError(
            f"all that collides below joint {chain.names[2]} lies at the joint: give geom {geom}, the foot, a pos"
        )
    return foot, candidates


def _check_lengths(vectors: _LegVectors, names: list[str]) -> None:
    """Check that thigh and calf have a length, and that the thigh joint is at the height of the hip's axis.

    The kinematics of this package have no vertical offset between hip joint and thigh joint.

    Args:
        vectors: Vectors between the joints and the foot of the leg.
        names: Names of the leg's joints, for the error message.

    Raises:
        ModelError: One of the two conditions is not met.
    """
    lengths = vectors.lengths
    if min(lengths) < _MIN_LINK_LENGTH:
        raise ModelError(f"a link below joint {names[1]} has no length")
    height = vectors.hip_to_thigh[2]
    if abs(height) > _LENGTH_TOLERANCE * sum(lengths):
        raise ModelError(f"joint {names[1]} lies {height:+.3f} m off the height of the hip's axis in its leg")


def _measure_leg(model: Any, data: Any, trunk: int, collides: Bools, joints: list[int]) -> Leg:
    """Measure the lengths, joint axes, joint offsets and foot of a leg. Raises ModelError for an invalid leg.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        trunk: Id of the trunk's body.
        collides: Mask of the geoms that collide with the ground, (ngeom,).
        joints: Ids of the leg's hinges, hip first.

    Returns:
        The leg; its name is empty, and its hip offset is positive to the left. `_name_legs` completes both.
    """
    chain = _read_chain(model, data, trunk, joints)
    foot, candidates = _find_sole(model, data, chain, collides)
    base = data.xmat[trunk].reshape(3, 3)
    foot_position = (body_points_to_world(data, foot.body, foot.centre) - data.xpos[trunk]) @ base
    vectors = _leg_vectors(chain, foot_position)
    _check_lengths(vectors, chain.names)
    offsets = _joint_offsets(chain, vectors)
    foot = extend_foot(model, data, joints[-1], candidates, foot, _tilts(model, joints, chain.signs, offsets))
    points, radii = _straighten_foot(data, base, chain, foot, vectors.pitches[1])
    return Leg(
        name="",
        joints=(joints[0], joints[1], joints[2]),
        signs=chain.signs,
        joint_offsets=offsets,
        hip=chain.anchors[0] + vectors.hip_to_thigh[0] * np.array((1.0, 0.0, 0.0)),
        hip_offset=float(vectors.hip_to_thigh[1] + vectors.thigh_to_knee[1] + vectors.knee_to_foot[1]),
        thigh_length=vectors.lengths[0],
        calf_length=vectors.lengths[1],
        foot=foot._replace(points=points, radii=radii),
    )


def _leg_vectors(chain: _Chain, foot_position: Floats) -> _LegVectors:
    """Return the vectors between the joints of a leg and its foot in the pose `qpos0`, leg frame.

    Args:
        chain: Joints of the leg.
        foot_position: Position of the foot's centre, base frame, (3,), m.

    Returns:
        The vectors.
    """
    hip, thigh, knee = chain.anchors
    return _LegVectors(*(chain.leg_rotation @ link for link in (thigh - hip, knee - thigh, foot_position - knee)))


def _joint_offsets(chain: _Chain, vectors: _LegVectors) -> Floats:
    """Return the hip, thigh and calf angles of a leg in the pose `qpos0`, (3,), rad, in [-π, π].

    The angles are measured from the leg straight down, about +x for the hip, about +y for thigh and calf.
    """
    lateral = chain.leg_rotation[1]
    thigh_pitch, calf_pitch = vectors.pitches
    offsets = np.array([np.arctan2(lateral[2], lateral[1]), thigh_pitch, calf_pitch - thigh_pitch])
    wrapped: Floats = np.arctan2(np.sin(offsets), np.cos(offsets))
    return wrapped


def _straighten_foot(data: Any, base: Floats, chain: _Chain, foot: Foot, calf_pitch: float) -> tuple[Floats, Floats]:
    """Rotate the points of a foot to the base frame with the leg straight down; drop redundant points.

    A point is redundant if it cannot be the lowest point of the foot.

    Args:
        data: `mujoco.MjData` with the kinematics of the pose `qpos0`.
        base: Rotation from the base frame to the world frame, (3, 3).
        chain: Joints of the leg.
        foot: The foot, with its points in the frame of its body.
        calf_pitch: Pitch angle of the calf in the pose `qpos0`, zero for straight down, rad.

    Returns:
        points: Positions of k points relative to the foot's centre, base frame with the leg straight down, (k, 3), m.
        radii: Radii of the balls about the k points, (k,), m.
    """
    body_rotation = data.xmat[foot.body].reshape(3, 3)
    sin, cos = np.sin(calf_pitch), np.cos(calf_pitch)
    straightened = np.array(((cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos))).T
    points = foot.points @ (straightened @ chain.leg_rotation @ base.T @ body_rotation).T
    return extreme_points(points, foot.radii)


def _tilts(model: Any, joints: list[int], signs: Floats, offsets: Floats) -> tuple[float, float]:
    """Estimate the smallest and the largest tilt that a shin can have while the robot stands.

    The tilt is the angle of the shin about the axis of the calf joint in the model, zero for straight down. In the
    direction in which the knee bends, the range covers the tilt in the model's keyframes. `StanceTilts` bounds this
    range.

    Args:
        model: Compiled `mujoco.MjModel`.
        joints: Ids of the hip, thigh and calf joints.
        signs: Directions of the joint axes, +1 or -1, see `Leg.signs`, (3,).
        offsets: Joint angles in the pose `qpos0`, see `Leg.joint_offsets`, (3,), rad.

    Returns:
        Smallest and largest tilt, rad.
    """
    qpos = model.jnt_qposadr[joints]
    angles = offsets + signs * (model.key_qpos[:, qpos] - model.qpos0[qpos])
    standing = float(np.abs(angles[:, 1] + angles[:, 2]).max()) if model.nkey else 0.0
    margin = STANCE_TILTS.margin
    bent = float(np.clip(standing + margin, STANCE_TILTS.min_bent, STANCE_TILTS.max_bent))
    bend = signs[2] * bend_direction(model, joints[2], float(signs[2]), float(offsets[2]))
    return (-bent if bend <= 0.0 else -margin), (bent if bend >= 0.0 else margin)


def bend_direction(model: Any, joint: int, sign: float, offset: float) -> float:
    """Infer the direction in which a knee bends from the limits of its calf joint.

    Args:
        model: Compiled `mujoco.MjModel`.
        joint: Id of the calf joint.
        sign: +1 if the calf joint turns about the leg's +y axis, -1 for the opposite direction.
        offset: Angle of the calf joint in the pose `qpos0`, zero with a straight leg, rad.

    Returns:
        -1 if the knee bends backward, 1 if it bends forward, 0 if the limits do not show the direction.
    """
    if not model.jnt_limited[joint]:
        return 0.0
    middle = offset + sign * float(model.jnt_range[joint].mean() - model.qpos0[model.jnt_qposadr[joint]])
    return float(np.sign(middle)) if abs(middle) > MIN_BEND_ANGLE else 0.0


def _name_legs(legs: list[Leg]) -> tuple[Leg, ...]:
    """Name the legs by the positions of their hips, and make their hip offsets positive outward.

    The names are fl, fr, hl and hr (f: front, h: hind, l: left, r: right).

    Args:
        legs: The four legs without names, with hip offsets that are positive to the left.

    Returns:
        The legs in the same order.

    Raises:
        ModelError: The hips are not at four corners around the origin of the base frame.
    """
    ahead, left = np.array([leg.hip[:2] for leg in legs]).T
    named = tuple(
        replace(
            leg,
            name=("f" if leg.hip[0] > ahead.mean() else "h") + ("l" if leg.hip[1] > left.mean() else "r"),
            hip_offset=leg.hip_offset if leg.hip[1] > left.mean() else -leg.hip_offset,
        )
        for leg in legs
    )
    around_origin = all(
        (leg.hip[0] > 0) == (leg.name[0] == "f") and (leg.hip[1] > 0) == (leg.name[1] == "l") for leg in named
    )
    if len({leg.name for leg in named}) < LEGS or not around_origin:
        places = ", ".join(str(_rounded(leg.hip)) for leg in named)
        raise ModelError(f"hips are wanted at four corners about the origin of the trunk; they are at {places} m")
    return named


def _rounded(axis: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in np.round(axis, 2) + 0.0)
