"""Compiler of the MuJoCo model of a robot in a scenario, with terrain, payload and actuators."""

import copy
import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from quad_env.actuation.models import ACTUATORS, Actuator, ResolvedTorqueSpeed, min_limit
from quad_env.columns import Array
from quad_env.config import GRAVITY, PhysicsOptions
from quad_env.robots.model_file import log_to_console
from quad_env.robots.part_names import foot_geoms, names_of_part
from quad_env.robots.robot import Robot
from quad_env.robots.scene import build_spec
from quad_env.robots.shapes import GROUND_BIT, box_corners, collision_mask, geom_ids, welded_bodies
from quad_env.scenarios.disturbances import Ground, Motors, Payload
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, Slope, SmoothRandom, Stairs, Terrain

PAYLOAD = "payload"
"""Name of the payload's body in the MuJoCo model."""
_GROUND = "ground"
"""Name of the ground plane's geom and of its material in the MuJoCo model."""
_TERRAIN = "terrain"
"""Name of the height field in the MuJoCo model, and prefix of the names of the stairs' geoms."""
_FLOOR_DEPTH = 1.0
"""Thickness of the solid ground below a height field or below a step of stairs, m."""
NO_SIMPLIFICATION = PhysicsOptions()
"""Default options: contacts, friction cone and joint friction stay as in the MJCF of the robot."""


def compile_model(
    robot: Robot,
    scenario: Scenario,
    actuator: Actuator = ACTUATORS["ideal"],
    timestep: float | None = None,
    solver_iterations: int | None = None,
    options: PhysicsOptions = NO_SIMPLIFICATION,
    visuals: bool = True,
) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot in a scenario.

    Args:
        robot: Robot of the model.
        scenario: Scenario, which defines terrain, ground contact, payload and motor limits.
        actuator: Model of the joint servos.
        timestep: Physics step, s; None for the value in the MJCF.
        solver_iterations: Maximum contact-solver iterations per physics step; None for the value in the MJCF.
        options: Simplifications of the physics.
        visuals: False to leave out the geoms that do not collide, see `build_spec`.

    Returns:
        The compiled model.
    """
    log_to_console()
    spec = build_spec(robot, visuals)
    spec.option.timestep = timestep or spec.option.timestep
    spec.option.iterations = solver_iterations or spec.option.iterations
    _add_terrain(spec, scenario.terrain)
    if scenario.payload is not None:
        _add_payload(spec, scenario.payload, robot)
    torque_limit = _set_actuators(spec, scenario.motors, actuator, robot)
    model = _compile_at_home_height(spec)
    model.actuator_forcerange[:] = np.stack((-torque_limit, torque_limit), axis=-1)
    # The joints have no torque limits of their own, because only the motors limit the torque.
    model.jnt_actfrclimited[:] = False
    if scenario.ground != Ground() or scenario.randomisation is not None:
        _set_ground(model, scenario.ground, robot)
    if options != NO_SIMPLIFICATION:
        _simplify(model, options, robot)
    return model


def _simplify(model: mujoco.MjModel, options: PhysicsOptions, robot: Robot) -> None:
    """Apply the simplifications in `options` to the compiled `model`, to make training faster.

    The options disable contacts of some geoms, replace the friction cone, or remove the dry friction of the joints. Two
    geoms of an explicit contact pair (the element `pair` of the MJCF) still collide.
    """
    if options.cone != "model":
        model.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{options.cone.upper()}")
    if options.joint_friction == "none":
        model.dof_frictionloss[:] = 0.0
    if options.contacts != "all":
        keeps_contact = model.geom_bodyid == 0
        keeps_contact[[geom for leg in robot.leg_names for geom in foot_geoms(model, leg)]] = True
        if options.contacts == "feet-trunk":
            keeps_contact |= np.isin(model.geom_bodyid, welded_bodies(model, model.body("base_link").id))
        model.geom_contype[~keeps_contact] = 0
        model.geom_conaffinity[~keeps_contact] = 0


def _add_terrain(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    """Add the `terrain` to the model specification `spec`; flat ground is the plane that `spec` has."""
    if isinstance(terrain, SmoothRandom | HeightField):
        _add_height_field(spec, terrain)
    elif isinstance(terrain, Stairs):
        _add_stairs(spec, terrain)
    elif isinstance(terrain, Slope):
        spec.geom(_GROUND).quat = slope_quaternion(terrain)


def _set_actuators(spec: mujoco.MjSpec, motors: Motors, actuator: Actuator, robot: Robot) -> NDArray[np.float64]:
    """Set motor type, filter and delay of the joint actuators, and return their torque limits, (12,), N·m.

    `motors` are the scenario's limits on torque and bandwidth. `actuator` is the model of the joint servos.
    """
    curve = None if actuator.curve is None else actuator.curve.resolve(robot)
    bandwidth = min_limit(motors.bandwidth, actuator.bandwidth)
    if curve is not None:
        _convert_to_dc_motors(spec, curve, robot)
    elif bandwidth is not None:
        _add_actuator_filter(spec, 1 / (2 * math.pi * bandwidth), robot)
    _set_actuator_delay(spec, actuator.delay)
    return torque_limits(robot, motors, curve)


def torque_limits(robot: Robot, motors: Motors, curve: ResolvedTorqueSpeed | None) -> NDArray[np.float64]:
    """Return the torque limit of each joint at standstill.

    Args:
        robot: Robot with the joints.
        motors: Limits of a scenario.
        curve: Torque-speed curve of the motors; None for motors with the same limit at every speed.

    Returns:
        Torque limits, (12,), N·m.
    """
    limits = np.full(robot.num_joints, motors.max_torque(robot))
    if curve is None:
        return limits
    return curve.peak_torque if motors.torque_limit is None else np.minimum(limits, curve.peak_torque)


def _compile_at_home_height(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile `spec` with the trunk at its height in the home pose, then restore the height in `qpos0`.

    MuJoCo computes constants, for example inverse weights, at `qpos0`, and the last bits of the constants depend on the
    trunk height. With the fixed height, the constants do not depend on the start height in the MJCF.
    """
    trunk = spec.body("base_link")
    start_height = float(trunk.pos[2])
    trunk.pos[2] = spec.key("home").qpos[2]
    model = spec.compile()
    model.qpos0[2] = start_height
    return model


def contact_sensors(model: mujoco.MjModel, part: str) -> list[str]:
    """Return the names of the MuJoCo sensors that count ground contacts of a robot part.

    Args:
        model: Compiled model.
        part: Name of the robot part, for example `trunk` or `fl_foot`.

    Returns:
        Names of the sensors of this part.
    """
    return names_of_part(f"{part}_ground", (model.sensor(number).name for number in range(model.nsensor)))


def trunk_corners(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Return the corners of the boxes around the trunk's collision geoms, base frame, (k, 3), m.

    Geoms of bodies that are welded to the trunk are included. At the start of an episode, no corner may be below the
    ground. If no geom of the trunk collides, see `PhysicsOptions`, the only corner is the centre of the trunk.
    """
    data = mujoco.MjData(model)
    root = model.body("base_link").id
    mujoco.mj_kinematics(model, data)
    rotation = data.xmat[root].reshape(3, 3)
    corners = []
    for body in welded_bodies(model, root):
        for geom in geom_ids(model, [body], collision_mask(model)):
            offset = data.xpos[body] - data.xpos[root]
            corners_world = box_corners(model, geom) @ data.xmat[body].reshape(3, 3).T + offset
            corners.append(corners_world @ rotation)
    return np.concatenate(corners or [np.zeros((1, 3))])


def make_stepping_model(model: mujoco.MjModel, sensors: Sequence[str] | None = None) -> mujoco.MjModel:
    """Return a copy of a model that MuJoCo simulates faster, with bit-identical results.

    MuJoCo evaluates only the sensors of the copy that are read. It does not search for constraint islands (groups of
    bodies that are simulated independently), because one robot has only one island.

    Args:
        model: Compiled model.
        sensors: Names of the sensors that are read; None for the trunk's contact sensors.

    Returns:
        Copy of the model.
    """
    stepping = copy.copy(model)
    sensors = contact_sensors(model, "trunk") if sensors is None else sensors
    unread = np.setdiff1d(np.arange(model.nsensor), [model.sensor(name).id for name in sensors])
    stepping.sensor_needstage[unread] = mujoco.mjtStage.mjSTAGE_NONE
    # `mj_setConst` must see the trunk at the home height, because `qpos0` has the height in the MJCF after compilation.
    stepping.qpos0[2] = stepping.key("home").qpos[2]
    stepping.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return stepping


Mounting = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Type of the IMU's pose on the trunk: position, base frame, (3), m; roll, pitch and yaw, (3), rad."""


def mount_imu(model: mujoco.MjModel, mounting: Mounting) -> None:
    """Set the position and the rotation of the IMU in a model.

    Args:
        model: Compiled model; this function changes it.
        mounting: Position of the IMU, base frame, (3), m, and its roll, pitch and yaw from the base frame, (3), rad.
    """
    position, rotation = mounting
    site = model.site("imu")
    site.pos = position
    site.sameframe = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    mujoco.mju_euler2Quat(model.site_quat[site.id], np.array(rotation[::-1]), "zyx")


def slope_quaternion(slope: Slope) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) that rotates the vertical onto the normal of a `slope`.

    The rotation is `-slope.angle` about the y axis of the world.
    """
    return math.cos(slope.angle / 2), 0.0, -math.sin(slope.angle / 2), 0.0


def _add_height_field(spec: mujoco.MjSpec, terrain: SmoothRandom | HeightField) -> None:
    """Add the height field of `terrain` at the origin, and move the ground plane to the field's lowest point."""
    heights = terrain.heights
    rows, columns = heights.normalized.shape
    spec.add_hfield(
        name=_TERRAIN,
        nrow=rows,
        ncol=columns,
        size=[*terrain.half, heights.span, _FLOOR_DEPTH],
        userdata=heights.normalized.ravel(),
    )
    position = (0.0, 0.0, heights.min_height)
    _add_ground(spec, name=_TERRAIN, type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=_TERRAIN, pos=position)
    spec.geom(_GROUND).pos = position


def _add_stairs(spec: mujoco.MjSpec, stairs: Stairs) -> None:
    """Add a box for each step of the stairs, and lower the ground plane to the foot of the stairs."""
    spec.geom(_GROUND).pos = (0.0, 0.0, -stairs.steps * stairs.rise)
    half_height = (stairs.rise + _FLOOR_DEPTH) / 2
    for number, ((start, end), top) in enumerate(stairs.boxes()):
        _add_ground(
            spec,
            name=f"{_TERRAIN}_{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=((start + end) / 2, 0.0, top - half_height),
            size=((end - start) / 2, stairs.half_width, half_height),
        )


def _add_ground(spec: mujoco.MjSpec, **geometry: object) -> None:
    """Add a terrain geom with the material, friction and softness of the ground plane.

    `geometry` are the attributes of the geom, such as name, type, position and size.
    """
    plane = spec.geom(_GROUND)
    bits = {"contype": plane.contype, "conaffinity": plane.conaffinity}
    spec.worldbody.add_geom(material=_GROUND, friction=plane.friction, solref=plane.solref, **bits, **geometry)


def _add_payload(spec: mujoco.MjSpec, payload: Payload, robot: Robot) -> None:
    """Add the payload, a cube on top of the trunk that does not collide."""
    moment = payload.moment_of_inertia
    height = robot.trunk_centre[2] + (robot.trunk_size[2] + payload.edge) / 2
    cube = spec.body("base_link").add_body(
        name=PAYLOAD,
        pos=(0.0, 0.0, height),
        # `ipos` is the centre of mass in the frame of the cube. By default MuJoCo would use the value of `pos`, and so
        # place the centre of mass at twice the height.
        ipos=(0.0, 0.0, 0.0),
        mass=payload.mass,
        inertia=(moment, moment, moment),
        explicitinertial=True,
    )
    cube.add_geom(
        name=PAYLOAD,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[payload.edge / 2] * 3,
        contype=0,
        conaffinity=0,
        group=1,
        material="dark",
    )


def _add_actuator_filter(spec: mujoco.MjSpec, time_constant: float, robot: Robot) -> None:
    """Add a first-order low-pass filter of the joint target to each servo; the filter starts at the home pose.

    `time_constant` is the time constant of the filter, s. MuJoCo integrates the filter exactly.
    """
    for actuator in spec.actuators:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        actuator.dynprm[0] = time_constant
    spec.key("home").act = robot.home_pose


def _convert_to_dc_motors(spec: mujoco.MjSpec, curve: ResolvedTorqueSpeed, robot: Robot) -> None:
    """Replace the joint servos by DC motors with the same stiffness and damping.

    `curve` are the torque-speed curves of the motors. The supply voltage is normalised to ±1 V. So the motor constant
    is 1 / no_load_speed, and the resistance is the motor constant divided by stall_torque. The force range of the
    actuator represents the current limit of the motor.
    """
    stall_torques = curve.stall_torque.tolist()
    no_load_speeds = curve.no_load_speed.tolist()
    joints = zip(spec.actuators, robot.joint_lower, robot.joint_upper, stall_torques, no_load_speeds, strict=True)
    for servo, lower, upper, stall_torque, no_load_speed in joints:
        stiffness = servo.gainprm[0]
        damping = -servo.biasprm[2]
        motor_constant = 1 / no_load_speed
        servo.inheritrange = 0.0
        servo.ctrlrange = (lower, upper)
        servo.set_to_dcmotor(
            motorconst=(motor_constant, motor_constant),
            resistance=motor_constant / stall_torque,
            saturation=(stall_torque, 0.0, 0.0),
            controller=(stiffness, 0.0, damping, 0.0, 0.0, 1.0),
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
        )


def servo_fields(model: mujoco.MjModel, expand: Callable[[str], Array]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return views of the model fields that hold the servo gains of n robots, (n, 12) each.

    Some model fields hold the gain, and others the negative gain.

    Args:
        model: Compiled model.
        expand: Function that gives every robot its own values of a model field, and returns the values, (n, ...).

    Returns:
        stiffness: Views of the fields with the stiffness or the negative stiffness, N·m/rad.
        damping: Views of the fields with the damping or the negative damping, N·m·s/rad.
    """
    gain = expand("actuator_gainprm")
    bias = expand("actuator_biasprm")
    if model.actuator_gaintype[0] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        # The gain parameters 4 and 6 of a DC motor are the stiffness and the damping of its controller.
        return (gain[:, :, 4],), (gain[:, :, 6],)
    return (gain[:, :, 0], bias[:, :, 1]), (bias[:, :, 2],)


def give_servo_gains(model: mujoco.MjModel, expand: Callable[[str], Array], servo: Array) -> None:
    """Write the servo gains of each robot into its model fields.

    Args:
        model: Compiled model.
        expand: Function that gives every robot its own values of a model field, and returns the values, (n, ...).
        servo: Stiffness, N·m/rad, and damping, N·m·s/rad, of each robot, (2, n, 12).
    """
    for gains, fields in zip(servo, servo_fields(model, expand), strict=True):
        for field in fields:
            np.copysign(gains, field, out=field)


def _set_actuator_delay(spec: mujoco.MjSpec, delay: float) -> None:
    """Delay the joint targets of every servo by `delay` seconds, rounded to whole physics steps."""
    steps = round(delay / spec.option.timestep)
    for servo in spec.actuators:
        servo.nsample = steps
        servo.delay = steps * spec.option.timestep


def initial_actuator_history(model: mujoco.MjModel, targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return MuJoCo's buffer of past joint targets, filled with the same `targets` for all past times.

    Args:
        model: Compiled model with delayed actuators.
        targets: Past joint targets, (12,), rad.

    Returns:
        Values for MuJoCo's data field `history`.
    """
    data = mujoco.MjData(model)
    for servo, target in enumerate(targets):
        samples = np.full((model.actuator_history[servo, 0], 1), target)
        mujoco.mj_initCtrlHistory(model, data, servo, None, samples)
    return np.array(data.history)


def _set_ground(model: mujoco.MjModel, ground: Ground, robot: Robot) -> None:
    """Set the friction and softness that `ground` defines on all ground geoms of the model.

    On soft ground, the time constant of the contacts follows from the depth that a foot sinks under a quarter of the
    robot's weight.
    """
    geoms = np.flatnonzero(model.geom_bodyid == 0)
    model.geom_priority[geoms] = 1
    model.geom_friction[geoms, 0] = ground.friction
    if ground.sink_depth > 0:
        _disable_shin_contacts(model, geoms, robot)
        calves = [model.body(f"{leg}_calf_link").id for leg in robot.leg_names]
        inverse_mass = model.body_invweight0[calves, 0].mean()
        impedance = model.geom_solimp[geoms[0], 1]
        foot_load = robot.mass * GRAVITY / len(robot.leg_names)
        time_constant = math.sqrt(ground.sink_depth / ((1 - impedance) * inverse_mass * foot_load))
        model.geom_solref[geoms] = (time_constant, 1.0)


def _disable_shin_contacts(model: mujoco.MjModel, ground: NDArray[np.intp], robot: Robot) -> None:
    """Disable contacts between the ground and the shins by the collision bit `GROUND_BIT`.

    After the change, only geoms with this bit collide with the ground. `ground` are the ids of the ground's geoms.
    """
    model.geom_contype[(model.geom_bodyid != 0) & collision_mask(model)] |= GROUND_BIT
    shins = model.body_weldid[[model.body(f"{leg}_calf_link").id for leg in robot.leg_names]]
    is_shin = np.isin(model.body_weldid[model.geom_bodyid], shins)
    is_shin[[geom for leg in robot.leg_names for geom in foot_geoms(model, leg)]] = False
    model.geom_contype[is_shin] &= ~GROUND_BIT
    model.geom_contype[ground] = 0
    model.geom_conaffinity[ground] = GROUND_BIT
