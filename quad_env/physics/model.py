"""The compiled MuJoCo model: the robot, with its motors and payload, on a terrain of some ground."""

import copy
import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from quad_env.actuation.models import ACTUATORS, Actuator, ResolvedTorqueSpeed, min_limit
from quad_env.columns import Array
from quad_env.config import GRAVITY
from quad_env.robots.model_file import log_to_console
from quad_env.robots.part_names import foot_geoms, names_of_part
from quad_env.robots.robot import Robot
from quad_env.robots.scene import build_spec
from quad_env.robots.shapes import GROUND_BIT, box_corners, collision_mask, geom_ids, welded_bodies
from quad_env.scenarios.disturbances import Ground, Payload
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, Slope, SmoothRandom, Stairs

PAYLOAD = "payload"
"""Name of the payload's body."""
_GROUND, _TERRAIN = "ground", "terrain"
_FLOOR_DEPTH = 1.0
"""m of solid ground below a height field or a tread."""


def compile_model(
    robot: Robot,
    scenario: Scenario,
    actuator: Actuator = ACTUATORS["ideal"],
    timestep: float | None = None,
    solver_iterations: int | None = None,
) -> mujoco.MjModel:
    """The robot with these motors in that scenario, with that time, s, and contact-solver iterations a physics step, or
    the MJCF's."""
    log_to_console()
    terrain, motors = scenario.terrain, scenario.motors
    spec = build_spec(robot)
    spec.option.timestep = timestep or spec.option.timestep
    spec.option.iterations = solver_iterations or spec.option.iterations
    if isinstance(terrain, SmoothRandom | HeightField):
        _add_height_field(spec, terrain)
    elif isinstance(terrain, Stairs):
        _add_stairs(spec, terrain)
    elif isinstance(terrain, Slope):
        spec.geom(_GROUND).quat = slope_quaternion(terrain)
    if scenario.payload is not None:
        _add_payload(spec, scenario.payload, robot)
    bandwidth = min_limit(motors.bandwidth, actuator.bandwidth)
    limit = np.full(robot.num_joints, motors.max_torque(robot))
    if actuator.curve is not None:
        line = actuator.curve.resolve(robot)
        _convert_to_dc_motors(spec, line, robot)
        limit = line.peak_torque if motors.torque_limit is None else np.minimum(limit, line.peak_torque)
    elif bandwidth is not None:
        _add_actuator_filter(spec, 1 / (2 * math.pi * bandwidth), robot)
    _delay(spec, actuator.delay)
    model = _compiled(spec)
    model.actuator_forcerange[:] = np.stack((-limit, limit), axis=-1)
    model.jnt_actfrclimited[:] = False  # the motors' limit is the only one, for every peak torque and strength
    if scenario.ground != Ground() or scenario.randomisation is not None:
        _set_ground(model, scenario.ground, robot)
    return model


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """MuJoCo derives constants such as inverse weights where the robot is at `qpos0`, and their last bits depend on its
    height: they are worked out at the home pose's, as ever, whatever height the MJCF starts from."""
    trunk = spec.body("base_link")
    start, trunk.pos[2] = float(trunk.pos[2]), spec.key("home").qpos[2]
    model = spec.compile()
    model.qpos0[2] = start
    return model


def contact_sensors(model: mujoco.MjModel, part: str) -> list[str]:
    """Names of the sensors of the contacts of a part, such as `trunk` or `fl_foot`, with the ground."""
    return names_of_part(f"{part}_ground", (model.sensor(number).name for number in range(model.nsensor)))


def trunk_corners(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Corners of the boxes around what collides of the trunk, bodies welded to it included, base frame, (k, 3), m."""
    data, root = mujoco.MjData(model), model.body("base_link").id
    mujoco.mj_kinematics(model, data)
    axes, found = data.xmat[root].reshape(3, 3), []
    for body in welded_bodies(model, root):
        for geom in geom_ids(model, [body], collision_mask(model)):
            at = box_corners(model, geom) @ data.xmat[body].reshape(3, 3).T + (data.xpos[body] - data.xpos[root])
            found.append(at @ axes)
    return np.concatenate(found)


def make_stepping_model(model: mujoco.MjModel, sensors: Sequence[str] | None = None) -> mujoco.MjModel:
    """A copy that steps to the same bits faster: of all sensors it evaluates those that are read, by default those of
    the trunk's contacts, and it does not search for islands of constraints, of which one robot has only one."""
    lean, sensors = copy.copy(model), contact_sensors(model, "trunk") if sensors is None else sensors
    unread = np.setdiff1d(np.arange(model.nsensor), [model.sensor(name).id for name in sensors])
    lean.sensor_needstage[unread] = mujoco.mjtStage.mjSTAGE_NONE
    lean.qpos0[2] = lean.key("home").qpos[2]  # where `mj_setConst` of payloads is to work, see `_compiled`
    lean.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return lean


Mounting = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Place of something on the trunk, m, base frame, and roll, pitch and yaw from the base frame, rad."""


def mount_imu(model: mujoco.MjModel, mounting: Mounting) -> None:
    """Put the IMU there."""
    (position, rotation), site = mounting, model.site("imu")
    site.pos, site.sameframe = position, mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    mujoco.mju_euler2Quat(model.site_quat[site.id], np.array(rotation[::-1]), "zyx")


def slope_quaternion(slope: Slope) -> tuple[float, float, float, float]:
    """Turns the vertical onto the normal of the slope: by −angle about the world's y axis."""
    return math.cos(slope.angle / 2), 0.0, -math.sin(slope.angle / 2), 0.0


def _add_height_field(spec: mujoco.MjSpec, terrain: SmoothRandom | HeightField) -> None:
    """About the origin; the plane around it is as low as its lowest point."""
    heights = terrain.heights
    rows, columns = heights.normalized.shape
    spec.add_hfield(
        name=_TERRAIN,
        nrow=rows,
        ncol=columns,
        size=[*terrain.half, heights.span, _FLOOR_DEPTH],
        userdata=heights.normalized.ravel(),
    )
    place = (0.0, 0.0, heights.min_height)
    _add_ground(spec, name=_TERRAIN, type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=_TERRAIN, pos=place)
    spec.geom(_GROUND).pos = place


def _add_stairs(spec: mujoco.MjSpec, stairs: Stairs) -> None:
    """A box a step; the plane is the level below the last one."""
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
    """A geom of the same ground as the plane."""
    plane = spec.geom(_GROUND)
    bits = {"contype": plane.contype, "conaffinity": plane.conaffinity}
    spec.worldbody.add_geom(material=_GROUND, friction=plane.friction, solref=plane.solref, **bits, **geometry)


def _add_payload(spec: mujoco.MjSpec, payload: Payload, robot: Robot) -> None:
    """A cube that stands on top of the trunk."""
    moment = payload.mass * payload.edge**2 / 6
    height = robot.trunk_centre[2] + (robot.trunk_size[2] + payload.edge) / 2
    cube = spec.body("base_link").add_body(
        name=PAYLOAD,
        pos=(0.0, 0.0, height),
        ipos=(0.0, 0.0, 0.0),  # else MuJoCo's specification takes `pos` for it, and the mass sits twice as high
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
    """A first-order filter before each servo, integrated exactly; the home pose begins with the filters at home."""
    for actuator in spec.actuators:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        actuator.dynprm[0] = time_constant
    spec.key("home").act = robot.home_pose


def _convert_to_dc_motors(spec: mujoco.MjSpec, line: ResolvedTorqueSpeed, robot: Robot) -> None:
    """DC motors on a supply of ±1 V instead of servos, with the servos' gains: in these units K = 1 / no_load_speed and
    R = K / stall_torque. The limit of the current is the actuator's force range."""
    figures = line.stall_torque.tolist(), line.no_load_speed.tolist()
    for servo, lower, upper, stall, speed in zip(
        spec.actuators, robot.joint_lower, robot.joint_upper, *figures, strict=True
    ):
        kp, kv, constant = servo.gainprm[0], -servo.biasprm[2], 1 / speed
        servo.inheritrange, servo.ctrlrange = 0.0, (lower, upper)
        servo.set_to_dcmotor(
            motorconst=(constant, constant),
            resistance=constant / stall,
            saturation=(stall, 0.0, 0.0),
            controller=(kp, 0.0, kv, 0.0, 0.0, 1.0),
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
        )


def servo_fields(model: mujoco.MjModel, expand: Callable[[str], Array]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Where n robots of that model have stiffness and damping of their servos, with either sign, (n, 12) each; `expand`
    gives a field's values of each robot."""
    gain, bias = expand("actuator_gainprm"), expand("actuator_biasprm")
    if model.actuator_gaintype[0] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        return (gain[:, :, 4],), (gain[:, :, 6],)  # of its controller
    return (gain[:, :, 0], bias[:, :, 1]), (bias[:, :, 2],)


def give_servo_gains(model: mujoco.MjModel, expand: Callable[[str], Array], servo: Array) -> None:
    """Give n robots of that model servo gains of their own, (2, n, 12)."""
    for gains, fields in zip(servo, servo_fields(model, expand), strict=True):
        for field in fields:
            np.copysign(gains, field, out=field)


def _delay(spec: mujoco.MjSpec, delay: float) -> None:
    """Every servo goes by the target of `delay` ago, a whole number of physics steps."""
    steps = round(delay / spec.option.timestep)
    for servo in spec.actuators:
        servo.nsample, servo.delay = steps, steps * spec.option.timestep


def initial_actuator_history(model: mujoco.MjModel, targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """MuJoCo's record of past targets at the start of an episode, all of them these, (12,), rad."""
    data = mujoco.MjData(model)
    for servo, target in enumerate(targets):
        samples = np.full((model.actuator_history[servo, 0], 1), target)
        mujoco.mj_initCtrlHistory(model, data, servo, None, samples)
    return np.array(data.history)


def _set_ground(model: mujoco.MjModel, ground: Ground, robot: Robot) -> None:
    geoms = np.flatnonzero(model.geom_bodyid == 0)
    model.geom_priority[geoms] = 1
    model.geom_friction[geoms, 0] = ground.friction
    if ground.sink_depth > 0:
        _disable_shin_contacts(model, geoms, robot)
        legs_end = [model.body(f"{leg}_calf_link").id for leg in robot.leg_names]
        inverse_inertia = model.body_invweight0[legs_end, 0].mean()
        impedance = model.geom_solimp[geoms[0], 1]
        load = robot.mass * GRAVITY / len(robot.leg_names)
        time_constant = math.sqrt(ground.sink_depth / ((1 - impedance) * inverse_inertia * load))
        model.geom_solref[geoms] = (time_constant, 1.0)


def _disable_shin_contacts(model: mujoco.MjModel, ground: NDArray[np.intp], robot: Robot) -> None:
    """Ground and shins do not collide, all else as before: the ground has a bit of its own, see `collisions`."""
    model.geom_contype[(model.geom_bodyid != 0) & collision_mask(model)] |= GROUND_BIT
    shins = model.body_weldid[[model.body(f"{leg}_calf_link").id for leg in robot.leg_names]]
    below = np.isin(model.body_weldid[model.geom_bodyid], shins)
    below[[geom for leg in robot.leg_names for geom in foot_geoms(model, leg)]] = False
    model.geom_contype[below] &= ~GROUND_BIT
    model.geom_contype[ground], model.geom_conaffinity[ground] = 0, GROUND_BIT
