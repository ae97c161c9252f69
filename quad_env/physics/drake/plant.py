"""Converter of a compiled MuJoCo model (a robot on planes and boxes) to a plant, Drake's multibody model."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydrake import geometry
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody import plant as multibody
from pydrake.multibody import tree
from pydrake.systems.framework import Diagram, DiagramBuilder

from quad_env.columns import EnvIndices

# Drake's warnings are hidden, because Drake warns that deformable bodies do not collide with half spaces.
logging.getLogger("drake").setLevel(logging.ERROR)

DISSIPATION = 10.0
"""Hunt-Crossley dissipation d of contacts, s/m.

With this value a contact under half of the robot's weight is critically damped, as in MuJoCo. The speed of a bounce is
at most 1/d, which is 0.1 m/s.
"""
_STICTION_SPEED = 0.01
"""Joint speed below which the dry friction of a joint is proportional to the speed, rad/s.

A smaller value is closer to Coulomb's law.
"""
_PLANE_SIZE = 1000.0
"""Edge length of the cube that replaces the ground plane if the ground also has boxes, m.

The plane is replaced, because Drake 1.51 crashes if there is a half space among many geometries.
"""


@dataclass(frozen=True)
class Plant:
    """Drake model of a robot, with index maps from MuJoCo to Drake; `build_plant` returns it."""

    diagram: Diagram
    plant: multibody.MultibodyPlant
    trunk: tree.RigidBody
    geoms: dict[int, int]
    """Drake's id of each collision geometry -> MuJoCo's id of the geom."""
    hinges: EnvIndices
    """Index of each joint, in MuJoCo's order, among Drake's joint positions and joint velocities, (12,)."""
    servos: EnvIndices
    """Index of each servo, in MuJoCo's order, among Drake's actuators, (12,)."""


def build_plant(model: mujoco.MjModel) -> Plant:
    """Convert a compiled MuJoCo `model` of a robot to a Drake plant; the trunk must be the first body of `model`."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    builder = DiagramBuilder()
    # The approximation "lagged" computes friction with the normal force of the last step. Convex approximations are
    # not used, because they lift sliding bodies off the ground.
    config = multibody.MultibodyPlantConfig(time_step=model.opt.timestep, discrete_contact_approximation="lagged")
    config.use_sampled_output_ports = config.adjacent_bodies_collision_filters = False
    plant, scene = multibody.AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
    bodies = _add_bodies(plant, model, data)
    trunk = next(iter(bodies.values()))
    bodies[0] = plant.world_body()
    joints = [_add_joint(plant, model, data, bodies, joint) for joint in range(1, model.njnt)]
    servos = [_add_servo(plant, model, joints, servo) for servo in range(model.nu)]
    _add_joint_friction(plant, model, joints)
    geometry_ids = dict(_add_geoms(plant, model, data, bodies))
    plant.Finalize()
    _filter_collisions(scene, model, geometry_ids)
    return Plant(
        diagram=builder.Build(),
        plant=plant,
        trunk=trunk,
        geoms={geometry_id.get_value(): geom for geom, geometry_id in geometry_ids.items()},
        hinges=np.array([joint.velocity_start() - 6 for joint in joints], np.intp),
        servos=np.array([int(servo.index()) for servo in servos], np.intp),
    )


def spatial_inertia(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> tree.SpatialInertia:
    """Compute the spatial inertia of a body and all bodies that are welded to it.

    Args:
        model: Compiled model.
        data: Data of the model with body poses from `mj_kinematics`.
        body: MuJoCo's id of the body; a joint must connect this body to its parent.

    Returns:
        Spatial inertia about the origin of the body, in the axes of the body.
    """
    rotation_body_from_world = data.xmat[body].reshape(3, 3).T
    total = tree.SpatialInertia.Zero()
    for part in np.flatnonzero((model.body_weldid == body) & (model.body_mass > 0)):
        rotation = RotationMatrix(rotation_body_from_world @ data.ximat[part].reshape(3, 3))
        central_inertia = tree.RotationalInertia(*model.body_inertia[part]).ReExpress(rotation)
        centre = rotation_body_from_world @ (data.xipos[part] - data.xpos[body])
        total += tree.SpatialInertia.MakeFromCentralInertia(model.body_mass[part], centre, central_inertia)
    return total


def _add_bodies(plant: Any, model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, Any]:
    """Add a Drake body for each group of welded MuJoCo bodies, and return the Drake bodies.

    The result maps MuJoCo's id of the first body of a group to the Drake body.
    """
    roots = [body for body in range(1, model.nbody) if model.body_weldid[body] == body]
    return {root: plant.AddRigidBody(f"body_{root}", spatial_inertia(model, data, root)) for root in roots}


def _add_joint(plant: Any, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, Any], joint: int) -> Any:
    """Add a hinge joint to the Drake plant, with the same joint angle as in MuJoCo, and return the joint.

    `bodies` are the Drake bodies by MuJoCo's id. `joint` is MuJoCo's id of the joint.
    """
    name = model.joint(joint).name
    axis = model.jnt_axis[joint]
    child = int(model.jnt_bodyid[joint])
    parent = int(model.body_weldid[model.body_parentid[child]])
    reference = model.qpos0[int(model.jnt_qposadr[joint])]
    child_pose = RigidTransform(model.jnt_pos[joint])
    to_reference = RigidTransform(AngleAxis(-reference, axis), np.zeros(3))
    parent_pose = _pose(data, parent).InvertAndCompose(_pose(data, child)) @ child_pose @ to_reference
    frames = [
        plant.AddFrame(tree.FixedOffsetFrame(f"{name}_{end}", bodies[body].body_frame(), pose))
        for end, body, pose in (("parent", parent, parent_pose), ("child", child, child_pose))
    ]
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    damping = model.dof_damping[model.jnt_dofadr[joint]]
    return plant.AddJoint(tree.RevoluteJoint(name, *frames, axis, lower, upper, damping))


def _add_servo(plant: Any, model: mujoco.MjModel, joints: list[Any], servo: int) -> Any:
    """Add a joint servo, with implicitly integrated stiffness and damping, to the Drake plant, and return it.

    `joints` are the Drake joints in MuJoCo's order. `servo` is MuJoCo's id of the actuator. The armature of the MuJoCo
    joint becomes the rotor inertia in Drake.
    """
    joint = int(model.actuator_trnid[servo, 0])
    torque_limit = model.actuator_forcerange[servo, 1]
    actuator = plant.AddJointActuator(model.actuator(servo).name, joints[joint - 1], torque_limit)
    actuator.set_default_rotor_inertia(model.dof_armature[model.jnt_dofadr[joint]])
    stiffness = model.actuator_gainprm[servo, 0]
    damping = -model.actuator_biasprm[servo, 2]
    actuator.set_controller_gains(tree.PdControllerGains(p=stiffness, d=damping))
    return actuator


def _add_joint_friction(plant: Any, model: mujoco.MjModel, joints: list[Any]) -> None:
    """Add the dry friction of joints to the Drake plant, as velocity servos with target 0.

    A velocity servo with the target 0 brakes the joint; its torque is limited to the friction torque. `joints` are the
    Drake joints in MuJoCo's order.
    """
    for joint, torque, armature in zip(joints, model.dof_frictionloss[6:], model.dof_armature[6:], strict=True):
        if torque > 0:
            brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, torque)
            # The inertia is set here too, because Drake uses the rotor inertia of a joint's last actuator.
            brake.set_default_rotor_inertia(armature)
            brake.set_controller_gains(tree.PdControllerGains(p=0.0, d=torque / _STICTION_SPEED))


def _add_geoms(
    plant: Any, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, Any]
) -> Iterator[tuple[int, Any]]:
    """Add the geoms that can collide to the Drake plant; yield MuJoCo's id and Drake's id of each geom.

    `bodies` are the Drake bodies by MuJoCo's id.
    """
    solid = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    ground = solid[model.geom_bodyid[solid] == 0]
    frictions = _drake_frictions(model, solid, ground[0])
    for geom, friction in zip(solid.tolist(), frictions, strict=True):
        material = geometry.ProximityProperties()
        coulomb = multibody.CoulombFriction(friction, friction)
        geometry.AddContactMaterial(DISSIPATION, 2 * _contact_stiffness(model, ground[0]), coulomb, material)
        root = int(model.body_weldid[model.geom_bodyid[geom]])
        world_pose = RigidTransform(RotationMatrix(data.geom_xmat[geom].reshape(3, 3)), data.geom_xpos[geom])
        pose = _pose(data, root).InvertAndCompose(world_pose)
        shape = _shape(model, geom)
        if isinstance(shape, geometry.HalfSpace) and len(ground) > 1:
            pose = pose @ RigidTransform([0.0, 0.0, -_PLANE_SIZE / 2])
            shape = geometry.Box(_PLANE_SIZE, _PLANE_SIZE, _PLANE_SIZE)
        yield geom, plant.RegisterCollisionGeometry(bodies[root], pose, shape, f"geom_{geom}", material)


def _drake_frictions(model: mujoco.MjModel, geoms: EnvIndices, ground: int) -> NDArray[np.float64]:
    """Compute Drake's friction coefficients of `geoms`, for the same friction on the ground as in MuJoCo.

    In MuJoCo, the contact of a geom with the ground has the coefficient µ, which is the coefficient of the ground if
    the ground has priority, and otherwise the larger coefficient of geom and ground. In Drake, µ is the harmonic mean
    2 a g / (a + g) of the coefficients a of the geom and g of the ground. With g as the largest µ of all geoms, this
    gives a = µ g / (2 g − µ). `geoms` are MuJoCo's ids of the geoms, and `ground` is the id of a ground geom.
    """
    geom_friction = model.geom_friction[geoms, 0]
    ground_friction = model.geom_friction[ground, 0]
    if model.geom_priority[ground]:
        pair_friction = np.full_like(geom_friction, ground_friction)
    else:
        pair_friction = np.maximum(geom_friction, ground_friction)
    is_ground = model.geom_bodyid[geoms] == 0
    largest = pair_friction[~is_ground].max()
    return np.asarray(np.where(is_ground, largest, pair_friction * largest / (2 * largest - pair_friction)))


def _contact_stiffness(model: mujoco.MjModel, ground: int) -> float:
    """Compute the stiffness of the contact between a foot and the ground in MuJoCo, N/m.

    `ground` is MuJoCo's id of a ground geom. `quad_env.scenarios.disturbances.Ground` explains the formula.
    """
    inverse_inertia = model.body_invweight0[model.body_weldid, 0].max()
    return float(1.0 / ((1.0 - model.geom_solimp[ground, 0]) * model.geom_solref[ground, 0] ** 2 * inverse_inertia))


def _shape(model: mujoco.MjModel, geom: int) -> Any:
    """Convert the shape of the MuJoCo geom `geom` to a Drake shape; a mesh becomes its convex hull."""
    size = model.geom_size[geom]
    match mujoco.mjtGeom(int(model.geom_type[geom])):
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return geometry.HalfSpace()
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return geometry.Sphere(size[0])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return geometry.Capsule(size[0], 2 * size[1])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return geometry.Cylinder(size[0], 2 * size[1])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return geometry.Ellipsoid(*size)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return geometry.Box(*(2 * size))
    mesh = model.mesh(int(model.geom_dataid[geom]))
    start = int(mesh.vertadr[0])
    count = int(mesh.vertnum[0])
    return geometry.Convex(model.mesh_vert[start : start + count].T.astype(np.float64), mesh.name)


def _filter_collisions(scene: Any, model: mujoco.MjModel, geometry_ids: dict[int, Any]) -> None:
    """Exclude collisions in Drake between all pairs of geoms that do not collide in MuJoCo.

    `scene` is the Drake scene graph. `geometry_ids` maps MuJoCo's id of each geom to Drake's id.
    """
    collision_filter = scene.collision_filter_manager()
    collides = _collision_matrix(model)
    for geom, geometry_id in geometry_ids.items():
        excluded = [other_id for other, other_id in geometry_ids.items() if other > geom and not collides[geom, other]]
        if excluded:
            declaration = geometry.CollisionFilterDeclaration()
            declaration.ExcludeBetween(geometry.GeometrySet(geometry_id), geometry.GeometrySet(excluded))
            collision_filter.Apply(declaration)


def _collision_matrix(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return True for each pair of geoms that can collide in MuJoCo, (ngeom, ngeom).

    A pair of geoms can collide if the collision bits match. Bodies do not collide if the model excludes their contacts,
    if they are welded together, or if one is the parent of the other. Explicit contact pairs always collide.
    """
    body = model.geom_bodyid
    weld = model.body_weldid[body]
    bits = (model.geom_contype[:, None] & model.geom_conaffinity) != 0
    is_parent = (model.body_weldid[model.body_parentid[weld]][:, None] == weld) & (weld != 0)
    is_excluded = np.isin((body[:, None] << 16) + body, model.exclude_signature)
    apart = is_parent | is_excluded | (weld[:, None] == weld)
    collides = (bits | bits.T) & ~(apart | apart.T)
    collides[model.pair_geom1, model.pair_geom2] = True
    collides[model.pair_geom2, model.pair_geom1] = True
    return np.asarray(collides)


def _pose(data: mujoco.MjData, body: int) -> RigidTransform:
    """Return the pose of the body with MuJoCo's id `body` in the world frame, as a Drake transform."""
    return RigidTransform(RotationMatrix(data.xmat[body].reshape(3, 3)), data.xpos[body])
