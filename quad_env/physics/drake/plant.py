"""Drake's plant of a compiled MuJoCo model: one robot on ground of planes and boxes."""

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

logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of half spaces, which deformable bodies do not meet

DISSIPATION = 10.0
"""Hunt and Crossley's, s/m: what loads a foot by twice its share of the robot's weight is damped critically, as in
MuJoCo, and nothing bounces off faster than at 1/d, 0.1 m/s."""
_DRY = 0.01
"""Speed below which a joint's dry friction is viscous, rad/s."""
_WIDE = 1000.0
"""Edge of the cube that stands for a plane among boxes, m: half spaces among many geometries crash Drake 1.51."""


@dataclass(frozen=True)
class Plant:
    """The robot in Drake, with the places of its parts."""

    diagram: Diagram
    plant: multibody.MultibodyPlant
    trunk: tree.RigidBody
    geoms: dict[int, int]
    """Drake's number of each geometry -> MuJoCo's id of the geom."""
    hinges: EnvIndices
    """Place among Drake's positions and velocities of each joint in MuJoCo's order, less those of the trunk."""
    servos: EnvIndices
    """Place among Drake's actuators of each servo in MuJoCo's order."""


def plant_of(model: mujoco.MjModel) -> Plant:
    """The plant of a robot of that model, whose trunk is its first body."""
    data, builder = mujoco.MjData(model), DiagramBuilder()
    mujoco.mj_kinematics(model, data)
    # "lagged": friction goes by the normal force of the last step; convex approximations lift what slides.
    config = multibody.MultibodyPlantConfig(time_step=model.opt.timestep, discrete_contact_approximation="lagged")
    config.use_sampled_output_ports = config.adjacent_bodies_collision_filters = False
    plant, scene = multibody.AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
    roots = [body for body in range(1, model.nbody) if model.body_weldid[body] == body]
    bodies = {root: plant.AddRigidBody(f"body_{root}", inertia(model, data, root)) for root in roots}
    bodies[0] = plant.world_body()
    joints = [_add_joint(plant, model, data, bodies, joint) for joint in range(1, model.njnt)]
    servos = [_add_servo(plant, model, joints, servo) for servo in range(model.nu)]
    _add_friction(plant, model, joints)
    geoms = dict(_add_geoms(plant, model, data, bodies))
    plant.Finalize()
    _filter(scene, model, geoms)
    return Plant(
        builder.Build(),
        plant,
        bodies[roots[0]],
        {number.get_value(): geom for geom, number in geoms.items()},
        np.array([joint.velocity_start() - 6 for joint in joints], np.intp),
        np.array([int(servo.index()) for servo in servos], np.intp),
    )


def inertia(model: mujoco.MjModel, data: mujoco.MjData, root: int) -> tree.SpatialInertia:
    """Of a body and all that is welded to it, about its origin and in its axes."""
    total, axes = tree.SpatialInertia.Zero(), data.xmat[root].reshape(3, 3)
    for body in np.flatnonzero((model.body_weldid == root) & (model.body_mass > 0)):
        turned = RotationMatrix(axes.T @ data.ximat[body].reshape(3, 3))
        about_centre = tree.RotationalInertia(*model.body_inertia[body]).ReExpress(turned)
        centre = axes.T @ (data.xipos[body] - data.xpos[root])
        total += tree.SpatialInertia.MakeFromCentralInertia(model.body_mass[body], centre, about_centre)
    return total


def _add_joint(plant: Any, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, Any], joint: int) -> Any:
    """A hinge, whose angle is that of `qpos`."""
    child, axis, place = int(model.jnt_bodyid[joint]), model.jnt_axis[joint], int(model.jnt_qposadr[joint])
    parent, name = int(model.body_weldid[model.body_parentid[child]]), model.joint(joint).name
    at, turn = RigidTransform(model.jnt_pos[joint]), RigidTransform(AngleAxis(-model.qpos0[place], axis), np.zeros(3))
    fixed = _pose(data, parent).InvertAndCompose(_pose(data, child)) @ at @ turn
    frames = [
        plant.AddFrame(tree.FixedOffsetFrame(f"{name}_{end}", bodies[body].body_frame(), pose))
        for end, body, pose in (("parent", parent, fixed), ("child", child, at))
    ]
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    damping = model.dof_damping[model.jnt_dofadr[joint]]
    return plant.AddJoint(tree.RevoluteJoint(name, *frames, axis, lower, upper, damping))


def _add_servo(plant: Any, model: mujoco.MjModel, joints: list[Any], servo: int) -> Any:
    """Its stiffness and damping are both implicit; armature is inertia of a rotor."""
    joint, name = int(model.actuator_trnid[servo, 0]), model.actuator(servo).name
    added = plant.AddJointActuator(name, joints[joint - 1], model.actuator_forcerange[servo, 1])
    added.set_default_rotor_inertia(model.dof_armature[model.jnt_dofadr[joint]])
    stiffness, damping = model.actuator_gainprm[servo, 0], -model.actuator_biasprm[servo, 2]
    added.set_controller_gains(tree.PdControllerGains(p=stiffness, d=damping))
    return added


def _add_friction(plant: Any, model: mujoco.MjModel, joints: list[Any]) -> None:
    """Dry friction of joints: a servo of that little torque that wants its joint at rest."""
    for joint, loss, armature in zip(joints, model.dof_frictionloss[6:], model.dof_armature[6:], strict=True):
        if loss > 0:
            brake = plant.AddJointActuator(f"{joint.name()}_friction", joint, loss)
            brake.set_default_rotor_inertia(armature)  # of a joint's actuators Drake takes the inertia of the last
            brake.set_controller_gains(tree.PdControllerGains(p=0.0, d=loss / _DRY))


def _add_geoms(
    plant: Any, model: mujoco.MjModel, data: mujoco.MjData, bodies: dict[int, Any]
) -> Iterator[tuple[int, Any]]:
    """What may collide: geom and Drake's id."""
    solid = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    ground = solid[model.geom_bodyid[solid] == 0]
    frictions = _frictions(model, solid, ground[0])
    for geom, friction in zip(solid.tolist(), frictions, strict=True):
        material, coulomb = geometry.ProximityProperties(), multibody.CoulombFriction(friction, friction)
        geometry.AddContactMaterial(DISSIPATION, 2 * _stiffness(model, ground[0]), coulomb, material)
        root, shape = int(model.body_weldid[model.geom_bodyid[geom]]), _shape(model, geom)
        at = RigidTransform(RotationMatrix(data.geom_xmat[geom].reshape(3, 3)), data.geom_xpos[geom])
        placed = _pose(data, root).InvertAndCompose(at)
        if isinstance(shape, geometry.HalfSpace) and len(ground) > 1:
            placed, shape = placed @ RigidTransform([0.0, 0.0, -_WIDE / 2]), geometry.Box(_WIDE, _WIDE, _WIDE)
        yield geom, plant.RegisterCollisionGeometry(bodies[root], placed, shape, f"geom_{geom}", material)


def _frictions(model: mujoco.MjModel, geoms: EnvIndices, ground: int) -> NDArray[np.float64]:
    """Coefficients of these geoms with which Drake's friction on the ground is MuJoCo's.

    MuJoCo's of a pair, µ, is the ground's where that has priority, else the larger; Drake's the harmonic mean
    2 a g / (a + g). With g the largest µ of all on that ground, a = µ g / (2 g − µ).
    """
    own, grounds = model.geom_friction[geoms, 0], model.geom_friction[ground, 0]
    pair = np.full_like(own, grounds) if model.geom_priority[ground] else np.maximum(own, grounds)
    largest = pair[model.geom_bodyid[geoms] != 0].max()
    return np.asarray(np.where(model.geom_bodyid[geoms] == 0, largest, pair * largest / (2 * largest - pair)))


def _stiffness(model: mujoco.MjModel, ground: int) -> float:
    """Of a contact, N/m: what MuJoCo's is for the end of a leg on that ground, see `Ground`, at first touch."""
    ends = model.body_invweight0[model.body_weldid, 0].max()
    return float(1.0 / ((1.0 - model.geom_solimp[ground, 0]) * model.geom_solref[ground, 0] ** 2 * ends))


def _shape(model: mujoco.MjModel, geom: int) -> Any:
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
    start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
    return geometry.Convex(model.mesh_vert[start : start + count].T.astype(np.float64), mesh.name)


def _filter(scene: Any, model: mujoco.MjModel, geoms: dict[int, Any]) -> None:
    """Leave those pairs to collide that do in MuJoCo."""
    filters, meet = scene.collision_filter_manager(), _collide(model)
    for geom, mine in geoms.items():
        if apart := [other for number, other in geoms.items() if number > geom and not meet[geom, number]]:
            sets = geometry.GeometrySet(mine), geometry.GeometrySet(apart)
            filters.Apply(geometry.CollisionFilterDeclaration().ExcludeBetween(*sets))


def _collide(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms collide with which, (ngeom, ngeom): bits match, no rule says otherwise, and no joint alone is
    between their bodies."""
    body, weld = model.geom_bodyid, model.body_weldid[model.geom_bodyid]
    bits = (model.geom_contype[:, None] & model.geom_conaffinity) != 0
    below = (model.body_weldid[model.body_parentid[weld]][:, None] == weld) & (weld != 0)
    excluded = np.isin((body[:, None] << 16) + body, model.exclude_signature)
    apart = below | excluded | (weld[:, None] == weld)
    meet = (bits | bits.T) & ~(apart | apart.T)
    pairs = model.pair_geom1, model.pair_geom2
    meet[pairs] = meet[pairs[::-1]] = True
    return np.asarray(meet)


def _pose(data: mujoco.MjData, body: int) -> RigidTransform:
    return RigidTransform(RotationMatrix(data.xmat[body].reshape(3, 3)), data.xpos[body])
