"""Detection and locking of a robot's joints that belong to no leg, such as joints of an arm or wheels.

A locked joint is removed from the model, and its body is welded to the parent body. The alternative is a stiff servo or
an equality constraint that holds the joint. Each of these would limit the stable time step, yield under load, and leave
joint coordinates in the state that policies do not expect. A welded body is exact at any time step and costs no
computation.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from quad_env.robots.feet import geom_points_to_world
from quad_env.robots.shapes import Bools, Floats, descendant_mask, geom_ids, ground_collision_mask, surface_points
from quad_env.robots.structure import (
    JOINTS_PER_LEG,
    LEGS,
    are_lateral_axes,
    find_branches,
    find_root_body,
    is_hip_axis,
)

WHEEL_ROUNDNESS = 0.8
"""Smallest roundness of a link that counts as a wheel, dimensionless.

The roundness is the smallest distance between the link's outline and its axis, divided by the largest distance. The
axle of a wheel is locked, because its rotation does not move the point that carries the load.
"""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
"""Angles around the axis of a hinge at which the distance of its link's outline is measured, (16,), rad."""


def find_non_leg_joints(mujoco: Any, model: Any) -> list[int]:
    """Find the joints to lock: hinges and slides below the trunk that belong to none of the four legs.

    A leg has one hinge about the trunk's x axis, followed by two parallel hinges. If a branch of the kinematic tree has
    more than three hinges, only its load-bearing hinges can belong to a leg. A load-bearing hinge moves colliding
    geoms, and is not the axle of a wheel.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.

    Returns:
        Ids of the joints. The list is empty if not exactly four legs are found, or if joints of other kinds exist: the
        module `structure` then refuses the model.
    """
    root = find_root_body(mujoco, model)
    kinds = mujoco.mjtJoint
    branches = find_branches(model, root)
    joints = [joint for branch in branches.values() for joint in branch]
    if not joints or not np.isin(model.jnt_type[joints], (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE)).all():
        return []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    collides = ground_collision_mask(model, root)
    base = data.xmat[_trunk_candidate(model, root, branches)].reshape(3, 3)
    legs = []
    for branch in branches.values():
        hinges = [joint for joint in branch if model.jnt_type[joint] == kinds.mjJNT_HINGE]
        if len(hinges) > JOINTS_PER_LEG:
            hinges = [joint for joint in hinges if _is_load_bearing(model, data, joint, collides)]
        if _is_leg(data.xaxis[hinges] @ base):
            legs.append(hinges)
    return sorted(set(joints).difference(*legs)) if len(legs) == LEGS else []


def _trunk_candidate(model: Any, root: int, branches: dict[int, list[int]]) -> int:
    """Return the id of the body that is probably the trunk.

    The trunk is the body from which at least four branches of the kinematic tree hang, or the root body if no body has
    four branches.

    Args:
        model: Compiled `mujoco.MjModel`.
        root: Id of the robot's root body.
        branches: Id of the first body of a branch of the kinematic tree -> ids of the joints in this branch.

    Returns:
        Id of the body.
    """
    parents = Counter(int(model.body_parentid[first]) for first in branches)
    (body, count), *_ = parents.most_common()
    return body if count >= LEGS else root


def lock_joints(mujoco: Any, spec: Any, model: Any, joints: Sequence[int]) -> Any:
    """Remove joints from a model and weld their bodies to the parent bodies.

    The bodies are welded in the pose of the first keyframe, or in the pose `qpos0` if the model has no keyframe. Bodies
    and geoms keep their ids.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the model, which is changed in place.
        model: Compiled `mujoco.MjModel` of `spec` before the change.
        joints: Ids of the joints to lock.

    Returns:
        Compiled `mujoco.MjModel` of the changed `spec`.
    """
    _keep_springs(spec, model)
    data = mujoco.MjData(model)
    qpos = model.jnt_qposadr[list(joints)]
    if model.nkey:
        data.qpos[qpos] = model.key_qpos[0][qpos]
    mujoco.mj_kinematics(model, data)
    bodies = {element.id: element for element in spec.bodies}
    locked = [element for element in spec.joints if element.id in joints]
    for body in {int(model.jnt_bodyid[joint]) for joint in joints}:
        _weld(mujoco, bodies[body], model, data, body)
    for element in (*_dependents(mujoco, spec, {element.name for element in locked}), *locked):
        spec.delete(element)
    remaining = np.delete(np.arange(model.nq), qpos)
    for key in spec.keys:
        key.qpos = model.key_qpos[key.id][remaining]
        key.qvel = []
        key.act = []
        key.ctrl = []
    return spec.compile()


def _weld(mujoco: Any, element: Any, model: Any, data: Any, body: int) -> None:
    """Fix a body to its parent in the relative pose that the two bodies have in a simulation state.

    Args:
        mujoco: The package `mujoco`.
        element: The body in the `mujoco.MjSpec`, which is changed.
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with the simulation state.
        body: Id of the body in `model`.
    """
    parent = int(model.body_parentid[body])
    inverse = np.zeros(4)
    mujoco.mju_negQuat(inverse, data.xquat[parent])
    quaternion = np.zeros(4)
    mujoco.mju_mulQuat(quaternion, inverse, data.xquat[body])
    element.set_frame(element.parent.add_frame())
    element.pos = (data.xpos[body] - data.xpos[parent]) @ data.xmat[parent].reshape(3, 3)
    element.quat = quaternion
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _keep_springs(spec: Any, model: Any) -> None:
    """Write the compiled stiffness and damping to joints that define them by the attribute `springdamper`.

    MuJoCo computes the values of `springdamper` from an inertia that changes when joints are locked.

    Args:
        spec: The `mujoco.MjSpec`, which is changed in place.
        model: Compiled `mujoco.MjModel` of `spec` before the joints are locked.
    """
    for joint in spec.joints:
        if joint.springdamper.any():
            dof = int(model.jnt_dofadr[joint.id])
            joint.stiffness = (model.jnt_stiffness[joint.id], *model.jnt_stiffnesspoly[joint.id])
            joint.damping = (model.dof_damping[dof], *model.dof_dampingpoly[dof])
            joint.springdamper = (0.0, 0.0)


def _dependents(mujoco: Any, spec: Any, names: set[str]) -> list[Any]:
    """Return the elements that must be deleted together with some joints, because they refer to these joints.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the model.
        names: Names of the deleted joints.

    Returns:
        All sensors, the tendons over these joints, and the motors and equalities of these joints or tendons.
    """
    transmissions = mujoco.mjtTrn
    equality_kinds = mujoco.mjtEq
    over = [tendon for tendon in spec.tendons if _wraps_any(mujoco, tendon, names)]
    tendons = {tendon.name for tendon in over}
    targets = {
        transmissions.mjTRN_JOINT: names,
        transmissions.mjTRN_JOINTINPARENT: names,
        transmissions.mjTRN_TENDON: tendons,
    }
    tied = {equality_kinds.mjEQ_JOINT: names, equality_kinds.mjEQ_TENDON: tendons}
    motors = [each for each in spec.actuators if each.target in targets.get(each.trntype, ())]
    equalities = [each for each in spec.equalities if {each.name1, each.name2} & tied.get(each.type, set())]
    return [*spec.sensors, *motors, *equalities, *over]


def _wraps_any(mujoco: Any, tendon: Any, names: set[str]) -> bool:
    """Return True if `tendon`, of a `mujoco.MjSpec`, runs over one of the joints named in `names`."""
    return any(wrap.type == mujoco.mjtWrap.mjWRAP_JOINT and wrap.target.name in names for wrap in tendon.path)


def bodies_moved_by(model: Any, joints: Sequence[int]) -> frozenset[int]:
    """Return the ids of all bodies in the compiled `model` that the joints with the ids `joints` move."""
    return frozenset(int(body) for joint in joints for body in np.flatnonzero(_moved_mask(model, joint)))


def _moved_mask(model: Any, joint: int) -> Bools:
    return descendant_mask(model, int(model.jnt_bodyid[joint]))


def _is_leg(axes: Floats) -> bool:
    """Return True if k hinges can form a leg: one hinge about x, then two parallel lateral hinges.

    `axes` are the unit vectors of the hinge axes, base frame, (k, 3), in the order from the trunk to the foot.
    """
    return len(axes) == JOINTS_PER_LEG and is_hip_axis(axes[0]) and are_lateral_axes(axes[1], axes[2])


def _is_load_bearing(model: Any, data: Any, joint: int, collides: Bools) -> bool:
    """Return True if a hinge moves geoms that collide with the ground and is not the axle of a wheel.

    Args:
        model: Compiled `mujoco.MjModel`.
        data: `mujoco.MjData` with kinematics.
        joint: Id of the hinge.
        collides: Mask of the geoms that collide with the ground, (ngeom,).

    Returns:
        False if the hinge moves no colliding geom, or if these geoms form a wheel about its axis; else True.
    """
    geoms = geom_ids(model, np.flatnonzero(_moved_mask(model, joint)), collides)
    if not geoms:
        return False
    axis = data.xaxis[joint]
    normal = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    normal /= np.linalg.norm(normal)
    directions = np.outer(np.cos(_ANGLES), normal) + np.outer(np.sin(_ANGLES), np.cross(axis, normal))
    hulls = [geom_points_to_world(model, data, geom, surface_points(model, geom)) for geom in geoms]
    points = np.concatenate(hulls) - data.xanchor[joint]
    reaches = (points @ directions.T).max(axis=0)
    return bool(reaches.min() < WHEEL_ROUNDNESS * reaches.max())
