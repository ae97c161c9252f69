"""Drake's plant of a compiled MuJoCo model: one robot on ground of planes and boxes."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JointActuator,
    PdControllerGains,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.framework import Diagram, DiagramBuilder

from quad_env.columns import Array, Rows

logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of half spaces, which deformable bodies do not meet

DISSIPATION = 10.0
"""Hunt and Crossley's, s/m: what loads a foot by twice its share of the robot's weight is damped critically, as in
MuJoCo, and nothing bounces off faster than at 1/d, 0.1 m/s."""
_DRY = 0.01
"""Speed below which a joint's dry friction is viscous, rad/s."""
_WIDE = 1000.0
"""Edge of the cube that stands for a plane among boxes, m: half spaces among many geometries crash Drake 1.51."""
_LAGGED = "lagged"
"""Drake's approximation of contact in which friction goes by the normal force of the last step: convex ones lift what
slides."""


@dataclass(frozen=True)
class Plant:
    """The robot in Drake, with the places of its parts."""

    diagram: Diagram
    plant: MultibodyPlant
    trunk: RigidBody
    geoms: dict[int, int]
    """Drake's number of each geometry -> MuJoCo's id of the geom."""
    hinges: Rows
    """Place among Drake's positions and velocities of each joint in MuJoCo's order, less those of the trunk."""
    servos: Rows
    """Place among Drake's actuators of each servo in MuJoCo's order."""


def plant_of(model: mujoco.MjModel) -> Plant:
    """The plant of a robot of that model, whose trunk is its first body."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    builder, how = (
        DiagramBuilder(),
        MultibodyPlantConfig(time_step=model.opt.timestep, adjacent_bodies_collision_filters=False),
    )
    how.discrete_contact_approximation, how.use_sampled_output_ports = _LAGGED, False
    plant, scene = AddMultibodyPlant(how, builder)
    plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
    roots = [body for body in range(1, model.nbody) if model.body_weldid[body] == body]
    bodies = {0: plant.world_body()} | {
        root: plant.AddRigidBody(f"body_{root}", inertia(model, data, root)) for root in roots
    }
    joints = [_add_joint(plant, model, data, bodies, joint) for joint in range(1, model.njnt)]
    servos = [_add_servo(plant, model, joints, servo) for servo in range(model.nu)]
    geoms = list(_add_geoms(plant, model, data, bodies))
    _add_friction(plant, model, joints)
    plant.Finalize()
    _filter(scene, model, geoms)
    return Plant(
        builder.Build(),
        plant,
        bodies[roots[0]],
        {number.get_value(): geom for geom, number, _ in geoms},
        np.array([joint.velocity_start() - 6 for joint in joints], np.intp),
        np.array([int(servo.index()) for servo in servos], np.intp),
    )


def inertia(model: mujoco.MjModel, data: mujoco.MjData, root: int) -> SpatialInertia:
    """Of a body and all that is welded to it, about its origin and in its axes."""
    total = SpatialInertia.Zero()
    axes = data.xmat[root].reshape(3, 3)
    for body in np.flatnonzero((model.body_weldid == root) & (model.body_mass > 0)):
        turned = axes.T @ data.ximat[body].reshape(3, 3)
        moments = turned @ np.diag(model.body_inertia[body]) @ turned.T
        about_centre = RotationalInertia(*np.diag(moments), moments[0, 1], moments[0, 2], moments[1, 2])
        centre = axes.T @ (data.xipos[body] - data.xpos[root])
        total += SpatialInertia.MakeFromCentralInertia(model.body_mass[body], centre, about_centre)
    return total


def _add_joint(
    plant: MultibodyPlant, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, RigidBody], joint: int
) -> RevoluteJoint:
    """A hinge, whose angle is that of `qpos`."""
    child, axis, place = int(model.jnt_bodyid[joint]), model.jnt_axis[joint], int(model.jnt_qposadr[joint])
    parent, name = int(model.body_weldid[model.body_parentid[child]]), model.joint(joint).name
    at, start = RigidTransform(model.jnt_pos[joint]), RigidTransform(_rotation(axis, -model.qpos0[place]), np.zeros(3))
    fixed = _pose(data, parent).InvertAndCompose(_pose(data, child)) @ at @ start
    frames = [
        plant.AddFrame(FixedOffsetFrame(f"{name}_{end}", bodies[body].body_frame(), pose))
        for end, body, pose in (("parent", parent, fixed), ("child", child, at))
    ]
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    damping = model.dof_damping[model.jnt_dofadr[joint]]
    return plant.AddJoint(RevoluteJoint(name, *frames, axis, lower, upper, damping))


def _add_servo(plant: MultibodyPlant, model: mujoco.MjModel, joints: list[RevoluteJoint], servo: int) -> JointActuator:
    """Its stiffness and damping are both implicit; armature is inertia of a rotor."""
    joint, name = int(model.actuator_trnid[servo, 0]), model.actuator(servo).name
    added = plant.AddJointActuator(name, joints[joint - 1], model.actuator_forcerange[servo, 1])
    added.set_default_rotor_inertia(model.dof_armature[model.jnt_dofadr[joint]])
    gains = PdControllerGains(p=model.actuator_gainprm[servo, 0], d=-model.actuator_biasprm[servo, 2])
    added.set_controller_gains(gains)
    return added


def _add_friction(plant: MultibodyPlant, model: mujoco.MjModel, joints: list[RevoluteJoint]) -> None:
    """Dry friction of joints: a servo of that little torque that wants its joint at rest."""
    losses = zip(joints, model.dof_frictionloss[6:], model.dof_armature[6:], strict=True)
    for joint, loss, armature in losses:
        if loss > 0:
            brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, loss)
            brake.set_default_rotor_inertia(armature)  # of a joint's actuators Drake takes the inertia of the last
            brake.set_controller_gains(PdControllerGains(p=0.0, d=loss / _DRY))


def _add_geoms(
    plant: MultibodyPlant, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, RigidBody]
) -> Iterator[tuple[int, Any, float]]:
    """What may collide: geom, Drake's id, and the friction between it and the ground.

    MuJoCo's is that of the one with the higher priority, else the larger; Drake's the harmonic mean. So both have the
    same, and where geoms of the robot differ, each kind has ground of its own, which it alone collides with.
    """
    solid = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    robot, ground = (solid[(model.geom_bodyid[solid] != 0) == of_robot] for of_robot in (True, False))
    frictions = {int(geom): _friction(model, geom, ground[0]) for geom in robot}
    doubled = [(int(geom), friction) for friction in sorted(set(frictions.values())) for geom in ground]
    for geom, friction in (*frictions.items(), *doubled):
        material = ProximityProperties()
        AddContactMaterial(DISSIPATION, 2 * _stiffness(model, ground[0]), CoulombFriction(friction, friction), material)
        root = int(model.body_weldid[model.geom_bodyid[geom]])
        at = RigidTransform(RotationMatrix(data.geom_xmat[geom].reshape(3, 3)), data.geom_xpos[geom])
        name = f"geom_{geom}_{friction}"
        placed, shape = _pose(data, root).InvertAndCompose(at), _shape(model, geom)
        if isinstance(shape, HalfSpace) and len(ground) > 1:
            placed, shape = placed @ RigidTransform([0.0, 0.0, -_WIDE / 2]), Box(_WIDE, _WIDE, _WIDE)
        yield geom, plant.RegisterCollisionGeometry(bodies[root], placed, shape, name, material), friction


def _friction(model: mujoco.MjModel, geom: int, ground: int) -> float:
    """Between a geom and the ground, as MuJoCo combines it."""
    both = [geom, ground]
    priority, friction = model.geom_priority[both], model.geom_friction[both, 0]
    return float(friction.max() if priority[0] == priority[1] else friction[priority.argmax()])


def _stiffness(model: mujoco.MjModel, ground: int) -> float:
    """Of a contact, N/m: what MuJoCo's is for the end of a leg on that ground, see `Ground`, at first touch."""
    ends = model.body_invweight0[model.body_weldid, 0].max()
    return float(1.0 / ((1.0 - model.geom_solimp[ground, 0]) * model.geom_solref[ground, 0] ** 2 * ends))


def _shape(model: mujoco.MjModel, geom: int) -> Any:
    size, kind = model.geom_size[geom], mujoco.mjtGeom(int(model.geom_type[geom]))
    shapes: dict[Any, Any] = {
        mujoco.mjtGeom.mjGEOM_PLANE: HalfSpace,
        mujoco.mjtGeom.mjGEOM_SPHERE: partial(Sphere, size[0]),
        mujoco.mjtGeom.mjGEOM_CAPSULE: partial(Capsule, size[0], 2 * size[1]),
        mujoco.mjtGeom.mjGEOM_CYLINDER: partial(Cylinder, size[0], 2 * size[1]),
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: partial(Ellipsoid, *size),
        mujoco.mjtGeom.mjGEOM_BOX: partial(Box, *(2 * size)),
    }
    if kind in shapes:
        return shapes[kind]()
    mesh = model.mesh(int(model.geom_dataid[geom]))
    start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
    return Convex(model.mesh_vert[start : start + count].T.astype(np.float64), mesh.name)


def _filter(scene: Any, model: mujoco.MjModel, geoms: list[tuple[int, Any, float]]) -> None:
    """Leave those pairs to collide that do in MuJoCo."""
    filters, (numbers, ids, frictions) = scene.collision_filter_manager(), zip(*geoms, strict=True)
    meet = _collide(model)[np.ix_(numbers, numbers)]
    grounds = model.geom_bodyid[list(numbers)] == 0
    for k, mine in enumerate(ids):
        other = np.array(frictions) != frictions[k]
        apart = ~meet[k] | (other & (grounds | grounds[k]))
        if found := [each for number, each in enumerate(ids) if number > k and apart[number]]:
            filters.Apply(CollisionFilterDeclaration().ExcludeBetween(GeometrySet(mine), GeometrySet(found)))


def _collide(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms collide with which, (ngeom, ngeom): bits match, no rule says otherwise, and no joint alone is
    between their bodies."""
    type_, affinity, body = model.geom_contype, model.geom_conaffinity, model.geom_bodyid
    bits = (type_[:, None] & affinity) | (affinity[:, None] & type_)
    weld = model.body_weldid[body]
    parent = model.body_weldid[model.body_parentid[weld]]
    related = ((parent[:, None] == weld) | (parent == weld[:, None])) & (weld != 0) & (weld != 0)[:, None]
    signatures = (body[:, None] << 16) + body
    excluded = np.isin(signatures, model.exclude_signature) | np.isin(signatures.T, model.exclude_signature)
    meet = (bits != 0) & (weld[:, None] != weld) & ~related & ~excluded
    pairs = model.pair_geom1, model.pair_geom2
    meet[pairs] = meet[pairs[::-1]] = True
    return np.asarray(meet)


def _pose(data: mujoco.MjData, body: int) -> RigidTransform:
    return RigidTransform(RotationMatrix(data.xmat[body].reshape(3, 3)), data.xpos[body])


def _rotation(axis: Array, angle: float) -> RotationMatrix:
    matrix, quaternion = np.zeros(9), np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return RotationMatrix(matrix.reshape(3, 3))
