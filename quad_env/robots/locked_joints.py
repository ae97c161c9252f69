"""Joints of a model that belong to none of its four legs, and how they are held: of an arm, a tail, wheels on the feet.

Such a joint is taken away, and its body is welded where the joint's reference has it. A servo, however stiff, or an
equality would be one more spring that decides which time step is stable, would yield under load, and would leave
coordinates in the state that no policy knows; a weld is exact at any time step and costs nothing.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from quad_env.robots.feet import geom_points_to_world
from quad_env.robots.shapes import Bools, Floats, descendant_mask, geom_ids, ground_collision_mask, surface_points
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS, are_lateral_axes, find_branches, find_root_body, is_hip_axis

ROUND = 0.8
"""Least reach of a wheel from its axis, as a share of its largest."""
_TURNS = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)


def find_non_leg_joints(mujoco: Any, model: Any) -> list[int]:
    """Ids of the hinges and slides below the trunk that belong to none of its four legs; none where it is unclear which
    these are, or where there are other joints, all of which `anatomy` refuses. Raises ModelError.

    A leg has a hinge about the trunk's x axis and two parallel ones. Of more than three hinges those count that bear:
    that move what collides and do not just turn it on the spot, as a wheel is.
    """
    root, kinds = find_root_body(mujoco, model), mujoco.mjtJoint
    trees = find_branches(model, root)
    joints = [joint for tree in trees.values() for joint in tree]
    if not joints or not np.isin(model.jnt_type[joints], (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE)).all():
        return []
    data, meets = mujoco.MjData(model), ground_collision_mask(model, root)
    mujoco.mj_kinematics(model, data)
    (above, count), *_ = Counter(int(model.body_parentid[first]) for first in trees).most_common()
    base = data.xmat[above if count >= LEGS else root].reshape(3, 3)
    legs = []
    for tree in trees.values():
        hinges = [joint for joint in tree if model.jnt_type[joint] == kinds.mjJNT_HINGE]
        if len(hinges) > JOINTS_PER_LEG:
            hinges = [joint for joint in hinges if _is_load_bearing(model, data, joint, meets)]
        if _is_leg(data.xaxis[hinges] @ base):
            legs.append(hinges)
    return sorted(set(joints).difference(*legs)) if len(legs) == LEGS else []


def lock_joints(mujoco: Any, spec: Any, model: Any, joints: Sequence[int]) -> Any:
    """Take these joints out of a specification, their bodies welded where the first keyframe or, without one, `qpos0`
    has them; its model. Bodies and geoms keep their ids."""
    _keep_springs(spec, model)
    data, places = mujoco.MjData(model), model.jnt_qposadr[list(joints)]
    if model.nkey:
        data.qpos[places] = model.key_qpos[0][places]
    mujoco.mj_kinematics(model, data)
    bodies, gone = {part.id: part for part in spec.bodies}, [part for part in spec.joints if part.id in joints]
    for body in {int(model.jnt_bodyid[joint]) for joint in joints}:
        part, above = bodies[body], int(model.body_parentid[body])
        back, turned = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, data.xquat[above])
        mujoco.mju_mulQuat(turned, back, data.xquat[body])
        part.set_frame(part.parent.add_frame())
        part.pos = (data.xpos[body] - data.xpos[above]) @ data.xmat[above].reshape(3, 3)
        part.quat, part.alt.type = turned, mujoco.mjtOrientation.mjORIENTATION_QUAT
    for part in (*_referring(mujoco, spec, {part.name for part in gone}), *gone):
        spec.delete(part)
    kept = np.delete(np.arange(model.nq), places)
    for key in spec.keys:
        key.qpos, key.qvel, key.act, key.ctrl = model.key_qpos[key.id][kept], [], [], []
    return spec.compile()


def _keep_springs(spec: Any, model: Any) -> None:
    """Write the compiled result of `springdamper` to the joints: it depends on an inertia that held joints change."""
    for part in spec.joints:
        if part.springdamper.any():
            dof = int(model.jnt_dofadr[part.id])
            part.stiffness = (model.jnt_stiffness[part.id], *model.jnt_stiffnesspoly[part.id])
            part.damping = (model.dof_damping[dof], *model.dof_dampingpoly[dof])
            part.springdamper = (0.0, 0.0)


def _referring(mujoco: Any, spec: Any, names: set[str]) -> list[Any]:
    """Tendons over joints of these names, motors and equalities of the joints or of these tendons, and all sensors."""
    kinds, ties, joint = mujoco.mjtTrn, mujoco.mjtEq, mujoco.mjtWrap.mjWRAP_JOINT
    over = [each for each in spec.tendons if any(w.type == joint and w.target.name in names for w in each.path)]
    tendons = {each.name for each in over}
    moved = {kinds.mjTRN_JOINT: names, kinds.mjTRN_JOINTINPARENT: names, kinds.mjTRN_TENDON: tendons}
    tied = {ties.mjEQ_JOINT: names, ties.mjEQ_TENDON: tendons}
    motors = [each for each in spec.actuators if each.target in moved.get(each.trntype, ())]
    equalities = [each for each in spec.equalities if {each.name1, each.name2} & tied.get(each.type, set())]
    return [*spec.sensors, *motors, *equalities, *over]


def bodies_moved_by(model: Any, joints: Sequence[int]) -> frozenset[int]:
    """Ids of the bodies that these joints move."""
    return frozenset(int(body) for joint in joints for body in np.flatnonzero(_moved(model, joint)))


def _moved(model: Any, joint: int) -> Bools:
    return descendant_mask(model, int(model.jnt_bodyid[joint]))


def _is_leg(axes: Floats) -> bool:
    """Whether hinges about these axes, (k, 3), of the base frame are those of a leg."""
    return len(axes) == JOINTS_PER_LEG and is_hip_axis(axes[0]) and are_lateral_axes(axes[1], axes[2])


def _is_load_bearing(model: Any, data: Any, joint: int, meets: Bools) -> bool:
    """Whether a hinge moves what meets the ground, and not as the axle of a wheel does."""
    geoms = geom_ids(model, np.flatnonzero(_moved(model, joint)), meets)
    if not geoms:
        return False
    axis = data.xaxis[joint]
    one = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    one /= np.linalg.norm(one)
    around = np.outer(np.cos(_TURNS), one) + np.outer(np.sin(_TURNS), np.cross(axis, one))
    points = (
        np.concatenate([geom_points_to_world(model, data, geom, surface_points(model, geom)) for geom in geoms])
        - data.xanchor[joint]
    )
    reaches = (points @ around.T).max(axis=0)
    return bool(reaches.min() < ROUND * reaches.max())
