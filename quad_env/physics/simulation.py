"""Simulation of n robots in a scenario: it resets and steps their physics, and computes their states."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.actuation.runtime import make_target_filter, make_thermal_model
from quad_env.columns import (
    Array,
    ComponentReader,
    Components,
    EnvIndices,
    EnvSelection,
    Mask,
    ScalarOrBatch,
    component_reader,
    not_finite,
    ordered_sum,
    to_components,
)
from quad_env.config import PhysicsOptions
from quad_env.physics.batch import RecordingBatch, make_batch
from quad_env.physics.energy import MotorMeter, touch_sensors
from quad_env.physics.footsteps import FootContactTracker, touching
from quad_env.physics.model import (
    NO_SIMPLIFICATION,
    PAYLOAD,
    Mounting,
    compile_model,
    contact_sensors,
    give_servo_gains,
    initial_actuator_history,
    make_stepping_model,
    mount_imu,
    slope_quaternion,
    trunk_corners,
)
from quad_env.physics.probe import IdealSensors, ideal_sensor_names
from quad_env.physics.randomisation import RandomisedModels
from quad_env.physics.rotations import quaternion
from quad_env.physics.simulators import MUJOCO, check_simulator
from quad_env.physics.state import QuadState, heading_velocity, rotation_matrix, to_body
from quad_env.robots.kinematics import foot_depths
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG
from quad_env.scenarios.episode import MovedProperties
from quad_env.scenarios.randomisation import RandomizationSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, Slope, SmoothRandom

ALL = slice(None)
"""Slice that selects all robots of a batch."""
Coordinates = tuple[Components[ScalarOrBatch], Components[ScalarOrBatch]]
"""Generalised positions, (19), and velocities, (18), in MuJoCo's order; see `Simulation.qpos` and `Simulation.qvel`."""
_DIVERGENCE = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADCTRL) + 1)
"""Slice of MuJoCo's warnings that mean divergence: bad position, velocity, acceleration or control."""
_LINKS = ("thigh", "calf")
_DRAWN_FIELDS = ("body_pos", "body_ipos", "body_mass", "body_subtreemass", "cam_poscom0", "light_poscom0")
"""Fields that can differ between robots and that move a drawn body, or the camera that follows the centre of mass."""
_SPAWN_HEIGHT = 10.0
"""Height from which a robot with a user's model is lowered onto uneven ground at the start, in leg lengths.

A trunk of many geoms must not start below the ground surface, because MuJoCo would run out of memory for contacts.
"""


@dataclass(frozen=True, eq=False)
class SimulationConfig:
    """Options of a `Simulation` in addition to the robot and the scenario."""

    num_envs: int = 1
    """Number of robots."""
    nthread: int = 1
    """Number of simulation threads; the results do not depend on this number."""
    control_rate: float = 100.0
    """Control steps per second, Hz; a control step must be a whole number of physics steps."""
    timestep: float | None = None
    """Physics step, s; None for the value in the MJCF."""
    solver_iterations: int | None = None
    """Maximum contact-solver iterations per physics step; None for the value in the MJCF."""
    physics: PhysicsOptions = NO_SIMPLIFICATION
    """Simplifications of contacts, friction cone and joint friction; none by default."""
    simulator: str = MUJOCO
    """Name of the physics engine: `mujoco`, `drake` or `warp`; see `quad_env.physics.simulators`."""
    actuator: Actuator = ACTUATORS["ideal"]
    """Model of the joint servos: torque-speed curve, bandwidth, delay and motor temperature."""
    servo_gains: Array | None = None
    """Stiffness, N·m/rad, and damping, N·m·s/rad, of the servos of each robot, (2, n, 12).

    None for the gains of the robot's model.
    """
    imu: Mounting | None = None
    """Position, base frame, (3), m, and roll, pitch and yaw, (3), rad, of the IMU on the trunk.

    With an IMU, the simulation has the reader of simulated sensors `Simulation.probe`. None for no simulated sensors.
    """
    has_meter: bool = False
    """True to measure motors and foot forces in every physics step, and ground contacts of feet, thighs and calves."""
    visuals: bool = True
    """False to simulate a model without geoms that do not collide; `Simulation.drawn_model` has them in any case."""
    tracks_footsteps: bool = False
    """True to compute swing times, touchdown speeds, contacts, heights and speeds of the feet for `QuadState`."""


class _ContactSensorNames(NamedTuple):
    """Names of the MuJoCo sensors that count ground contacts, grouped by robot part."""

    trunk: list[str]
    feet: list[list[str]]
    """Names of the sensors of each foot; empty if foot contacts are not read."""
    links: list[str]
    """Names of the sensors of all thighs and calves; empty if their contacts are not read."""


class Simulation:
    """Simulation of n robots in a scenario, which steps all robots together; each environment has one.

    The results do not depend on n or on the number of threads. Every simulator uses MuJoCo's field names, units and
    frames, see `quad_env.physics.batch`.

    ValueError is raised if the simulator does not support the scenario or an option. ValueError is also raised if the
    control period is not a whole number of physics steps.

    Args:
        robot: Robot to simulate.
        scenario: Scenario, which defines terrain, ground contact, payload, motor limits and domain randomisation.
        config: Further options, such as the number of robots; None for the defaults.
    """

    def __init__(self, robot: Robot, scenario: Scenario, config: SimulationConfig | None = None) -> None:
        config = config or SimulationConfig()
        check_simulator(
            config.simulator,
            scenario,
            config.actuator,
            sensors=config.imu is not None,
            readings=config.has_meter,
            per_env_servo_gains=config.servo_gains is not None,
        )
        self.robot = robot
        self.terrain = scenario.terrain
        self._scenario = scenario
        self._config = config
        self.model = self._compile_model(config.visuals)
        """Compiled MuJoCo model of the robots, with fields that may differ between robots.

        These fields are the payload position, the torque limits of hot motors, and randomised parameters. In this model
        the fields have the values of one robot, which the last call of `sync_model` has selected.
        """
        if config.imu is not None:
            mount_imu(self.model, config.imu)
        self.substeps = _count_substeps(config.control_rate, self.model.opt.timestep)
        """Number of physics steps in a control step."""
        contact_names = _contact_sensor_names(robot, self.model, config)
        self._process = os.getpid()
        self._has_threads = config.nthread > 1
        stepping_model = make_stepping_model(self.model, _sensor_names(robot, self.model, config, contact_names))
        self.batch = make_batch(config.simulator, stepping_model, config.num_envs, config.nthread)
        """Interface to the simulator, which steps the n robots."""
        self._bind_state(config.num_envs)
        self._bind_sensors(config)
        self._bind_contacts(contact_names)
        self._bind_geometry(config)
        self._bind_servo_gains(config.servo_gains)
        self._bind_loads(scenario)
        self._bind_actuators(scenario, config)
        self._bind_randomisation(scenario)

    def _compile_model(self, visuals: bool) -> mujoco.MjModel:
        """Compile the model of the robots, with or without geoms that do not collide."""
        config = self._config
        return compile_model(
            self.robot,
            self._scenario,
            config.actuator,
            config.timestep,
            config.solver_iterations,
            config.physics,
            visuals,
        )

    def _bind_state(self, num_envs: int) -> None:
        """Get the simulator's arrays of positions, velocities, targets and torques; create arrays for actions."""
        self.qpos = self.batch.bind("qpos")
        """Generalised positions of the robots in MuJoCo's order, (n, 19); writing to the array moves the robots.

        The order is the trunk centre, world frame, m, the trunk quaternion (w, x, y, z), and the joint angles, rad.
        """
        self.qvel = self.batch.bind("qvel")
        """Generalised velocities in MuJoCo's order, (n, 18); writing to this array changes the velocities.

        The order is the linear velocity of the trunk, world frame, m/s, its angular velocity, base frame, rad/s, and
        the joint velocities, rad/s.
        """
        self._ctrl = self.batch.bind("ctrl")
        self._filtered_ctrl = self.batch.bind("act") if self.model.na else None
        self._warnings = self.batch.warning[:, _DIVERGENCE, 1]
        self._servo_torque = self.batch.bind("actuator_force")
        self.torque = self._servo_torque
        """Torques of the joint servos in the last physics step, (n, 12), N·m."""
        self._action = np.tile(self.robot.home_pose, (num_envs, 1))
        self._previous_action = self._action.copy()
        self.leg_phase: Array | None = None
        """Phase of each leg in the gait clock of the learner, (n, 4), rad, see `QuadState`; None by default.

        The gait clock says when each leg should swing. The simulation itself has no gait clock. A learner with a gait
        clock sets the array before each step, because the reward term `gait` needs it.
        """
        joint_constants = (self.robot.home_pose, self.robot.joint_lower, self.robot.joint_upper)
        self._untracked_fields = (*(None,) * 6, *(constant.tolist() for constant in joint_constants))
        """Last nine fields of a `QuadState` without footsteps and gait clock: six times None, and joint constants.

        The constants are home pose, lower and upper joint limits, with one number per joint, (12), rad.
        """

    def _bind_sensors(self, config: SimulationConfig) -> None:
        """Create the meter of motors and foot forces, and the reader of sensor values, if `config` requests them."""
        robot, model = self.robot, self.model
        self.meter = MotorMeter(robot, self.batch, model, config.actuator) if config.has_meter else None
        """Meter of motor work, heat and foot impulses; None if `SimulationConfig.has_meter` is False."""
        self.probe = None if config.imu is None else IdealSensors(robot, self.batch, model, 1 / config.control_rate)
        """Reader of noise-free sensor values of IMU, joints and feet; None if `SimulationConfig.imu` is None."""
        if self.probe is not None:
            # The torques are copied, because the probe overwrites the outputs of the last physics step.
            self.torque = self.probe.copy(self.torque)

    def _bind_contacts(self, names: _ContactSensorNames) -> None:
        """Get the arrays of the contact sensors of trunk, feet, and thighs and calves, by their `names`."""
        self._trunk_contacts = self._contact_data(names.trunk)
        self._foot_contacts = [self._contact_data(sensors) for sensors in names.feet]
        self._link_contacts = self._contact_data(names.links)

    def _contact_data(self, names: Iterable[str]) -> list[Array]:
        """Return an array for each contact sensor in `names`: contact counts in the last physics step, (n, 1)."""
        data = [self.batch.sensor(name).data for name in names]
        return data if self.probe is None else [self.probe.copy(count) for count in data]

    def _bind_geometry(self, config: SimulationConfig) -> None:
        """Get the simulator's arrays of joint and site positions; create the footstep tracker if requested.

        Spawn height and footsteps are computed from these positions.
        """
        robot, model = self.robot, self.model
        self._site_positions = self.batch.bind("site_xpos")
        self._joint_positions = self.batch.bind("xanchor")
        self._feet = [model.site(f"{leg}_foot").id for leg in robot.leg_names]
        self._thighs = [model.joint(name).id for joint, name in enumerate(robot.joint_names) if joint % JOINTS_PER_LEG]
        self._corners = trunk_corners(model)
        self._spawn_clearance = self._compute_spawn_clearance()
        self._alignment = slope_quaternion(self.terrain) if isinstance(self.terrain, Slope) else None
        self._footsteps = None
        if config.tracks_footsteps:
            period = 1 / config.control_rate
            self._footsteps = FootContactTracker(
                period, self._foot_contacts, self._site_positions, self._feet, self.terrain, robot.foot_radius
            )

    def _compute_spawn_clearance(self) -> float:
        """Return the height above the home height, m, from which robots are lowered to the ground at the start."""
        is_bumpy = isinstance(self.terrain, SmoothRandom | HeightField)
        clearance = _SPAWN_HEIGHT * self.robot.leg_length if self.robot.imported and is_bumpy else 0.0
        if isinstance(self.terrain, HeightField):
            # The height of the highest point is added, because a user's height field may be at any height.
            clearance += self.terrain.heights.min_height + self.terrain.heights.span
        return clearance

    def _bind_servo_gains(self, servo_gains: Array | None) -> None:
        """Write the servo gains of each robot into its model, if `servo_gains` is not None.

        The gains are stiffness, N·m/rad, and damping, N·m·s/rad, (2, n, 12).
        """
        if servo_gains is not None:
            give_servo_gains(self.model, self.batch.expand, servo_gains)
        self._has_per_env_models = servo_gains is not None

    def _bind_loads(self, scenario: Scenario) -> None:
        """Get the simulator's arrays of the external force on the trunk and of the payload position."""
        self._push = self.batch.bind("xfrc_applied")[:, self.model.body("base_link").id, :2]
        self._steady_force: Array | None = None
        """Steady force on the trunk in an episode, such as wind, world frame, (n, 2), N; None if there is none."""
        self._payload_position: Array | None = None
        if scenario.payload is not None:
            self._payload_position = self.batch.expand("body_pos")[:, self.model.body(PAYLOAD).id, :2]

    def _bind_actuators(self, scenario: Scenario, config: SimulationConfig) -> None:
        """Create the low-pass filter of joint targets and the thermal model; get the array of past targets."""
        robot, model = self.robot, self.model
        actuator = config.actuator
        self._history = self.batch.bind("history") if model.nhistory else None
        self._initial_history = initial_actuator_history(model, robot.home_pose) if model.nhistory else None
        timestep = model.opt.timestep
        self._target_filter = make_target_filter(robot, scenario.motors, actuator, config.num_envs, timestep)
        self._thermal_model = make_thermal_model(robot, actuator, timestep, self.batch.expand)
        self._steps_singly = any((self.meter, self._target_filter, self._thermal_model))
        """True if the simulation must run Python code after every physics step.

        The code updates a motor meter, a low-pass filter of the joint targets or a thermal model.
        """
        self._records_all_steps = self.batch.features.outputs_of_all_steps
        """True if the simulator can advance robots by several physics steps and record the outputs of each."""
        self._recorded_fields = ("actuator_force",) if self.meter is None else self.meter.outputs
        """MuJoCo fields that the motor meter and the thermal model need of every physics step."""
        self._outputs: dict[str, Array] | None = None
        """Outputs of the physics steps of all robots, which the next control step overwrites."""

    def _bind_randomisation(self, scenario: Scenario) -> None:
        """Create the writer of randomised model parameters, if the scenario has domain randomisation."""
        self._randomised: RandomisedModels | None = None
        if scenario.randomisation is not None:
            limits = None if self._thermal_model is None else self._thermal_model.full_range
            self._randomised = RandomisedModels(self.model, self.batch.expand, limits)
            self._has_per_env_models = True

    def reset(
        self,
        env_ids: EnvIndices,
        rows: Array,
        force: Array | None = None,
        payload_position: Array | None = None,
        randomization: Sequence[RandomizationSample] = (),
        properties: Sequence[MovedProperties] = (),
    ) -> None:
        """Start episodes: put robots into their initial states, with the lowest point on the ground.

        Args:
            env_ids: Sorted indices of the robots, (k,).
            rows: Initial state of each robot, (k, 35), from `episode.draw_start`: x and y, m; yaw, roll and pitch, rad;
                12 joint offsets from the home pose, rad; 3 linear velocities, m/s; 3 angular and 12 joint velocities,
                rad/s.
            force: Steady force on the trunk, world frame, (k, 2), N; None for no steady force.
            payload_position: Position of the payload, base frame, (k, 2), m; None for the centre of the trunk.
            randomization: Randomised parameters of the k episodes; empty if the scenario has no domain randomisation.
            properties: Friction and payload of the k episodes; empty to keep the values of the models.
        """
        self._check_process()
        self.batch.reset(env_ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.batch.warning[env_ids] = 0
        qpos = self._start_positions(rows)
        self.qpos[env_ids] = qpos
        self.qvel[env_ids] = rows[:, 5 + self.robot.num_joints :]
        self._reset_actuators(env_ids, randomization)
        self._set_properties(env_ids, properties)
        self._reset_loads(env_ids, force, payload_position)
        self._place_on_ground(env_ids, qpos)
        self._reset_readings(env_ids)

    def _set_properties(self, env_ids: EnvIndices, properties: Sequence[MovedProperties]) -> None:
        """Write ground friction and payload of the k episodes into the models of the robots `env_ids`, (k,)."""
        if not properties:
            return
        self._has_per_env_models = True
        ground = slice(self.model.body_geomnum[0])
        self.batch.expand("geom_friction")[env_ids, ground, 0] = [[entry.friction] for entry in properties]
        if self._payload_position is not None:
            payload = self.model.body(PAYLOAD).id
            self.batch.expand("body_mass")[env_ids, payload] = [entry.payload_mass for entry in properties]
            self.batch.expand("body_inertia")[env_ids, payload] = [[entry.payload_inertia] for entry in properties]

    def _check_process(self) -> None:
        """Raise RuntimeError if this process is a fork of the process that created the simulation threads.

        A step would wait forever in a fork, because a fork does not have these threads.
        """
        if self._has_threads and os.getpid() != self._process:
            raise RuntimeError(
                f"this batch has threads of process {self._process}, which a fork, {os.getpid()}, does not have: make "
                "it in the process that steps it, start processes by spawn, or give nthread=1"
            )

    def _start_positions(self, rows: Array) -> Array:
        """Convert initial states `rows`, (k, 35), to generalised positions, (k, 19), at the home height.

        `reset` documents the order of an initial state.
        """
        robot = self.robot
        qpos = np.empty((len(rows), self.model.nq))
        qpos[:, 0:2] = rows[:, 0:2]
        qpos[:, 2] = robot.home_height
        qpos[:, 3:7] = quaternion(rows[:, 3], rows[:, 4], rows[:, 2])
        if self._alignment is not None:
            for orientation in qpos[:, 3:7]:
                mujoco.mju_mulQuat(orientation, self._alignment, orientation.copy())
        offsets = rows[:, 5 : 5 + robot.num_joints]
        qpos[:, 7:] = np.clip(robot.home_pose + offsets, robot.joint_lower, robot.joint_upper)
        return qpos

    def _reset_actuators(self, env_ids: EnvIndices, randomization: Sequence[RandomizationSample]) -> None:
        """Reset joint targets, actuator models and randomised parameters of the robots `env_ids`, (k,).

        `randomization` are the randomised parameters of the k episodes.
        """
        for targets in (self._ctrl, self._action, self._previous_action, self._filtered_ctrl):
            if targets is not None:
                targets[env_ids] = self.robot.home_pose
        if self._history is not None:
            self._history[env_ids] = self._initial_history
        if self._randomised is not None and randomization:
            self._randomised.reset(env_ids, randomization)
        self._reset_actuator_models(env_ids)

    def _reset_actuator_models(self, env_ids: EnvIndices) -> None:
        """Reset the low-pass filters of joint targets, and the motor temperatures, of the robots `env_ids`."""
        for part in (self._target_filter, self._thermal_model):
            if part is not None:
                part.reset(env_ids)

    def _reset_loads(self, env_ids: EnvIndices, force: Array | None, payload_position: Array | None) -> None:
        """Set steady forces and payload positions of the robots `env_ids`, and recompute their model constants.

        `force` is the steady force on the trunk, world frame, (k, 2), N. `payload_position` is relative to the centre
        of the trunk, base frame, (k, 2), m.
        """
        if force is not None:
            if self._steady_force is None:
                self._steady_force = np.zeros_like(self._push)
            self._steady_force[env_ids] = force
            self._push[env_ids] = force
        if self._payload_position is not None:
            self._payload_position[env_ids] = 0.0 if payload_position is None else payload_position
        if self._payload_position is not None or self._randomised is not None:
            self.batch.set_const(env_ids)

    def _place_on_ground(self, env_ids: EnvIndices, qpos: Array) -> None:
        """Move robots vertically until their lowest points touch the ground; `qpos`, (k, 19), are their positions."""
        qpos[:, 2] += self._spawn_clearance
        self.qpos[env_ids, 2] = qpos[:, 2]
        self.batch.forward(env_ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        self.qpos[env_ids, 2] += self._penetration_correction(env_ids, qpos)

    def _penetration_correction(self, env_ids: EnvIndices, qpos: Array) -> Array:
        """Return the vertical displacement with which the lowest point of each robot touches the ground, (k,), m.

        `qpos` are the generalised positions of the robots `env_ids`, (k, 19).
        """
        rotation = np.stack([np.stack(row, -1) for row in rotation_matrix(to_components(qpos[:, 3:7]))], 1)  # (k, 3, 3)
        corners = qpos[:, None, :3] + self._corners @ rotation.transpose(0, 2, 1)
        feet = self._site_positions[env_ids][:, self._feet]
        thighs = self._joint_positions[env_ids][:, self._thighs]
        foot_extra_depth = foot_depths(self.robot, rotation, qpos[:, 7:]) - self.robot.foot_radius
        spheres = (
            (feet, self.robot.foot_radius, foot_extra_depth),
            (thighs, self.robot.thigh_radius, 0.0),
            (corners, 0.0, 0.0),
        )
        corrections = [
            self.terrain.sphere_center_height(centre[:, :, 0], centre[:, :, 1], radius) - centre[:, :, 2] + extra_depth
            for centre, radius, extra_depth in spheres
        ]
        return cast("Array", np.concatenate(corrections, axis=1).max(axis=1))

    def _reset_readings(self, env_ids: EnvSelection) -> None:
        """Reset the footstep tracker, the motor meter and the stored sensor outputs of the robots `env_ids`."""
        if self._footsteps is not None:
            self._footsteps.reset(env_ids)
        if self.meter is not None:
            self.meter.reset(env_ids)
        if self.probe is not None:
            self.probe.refresh(env_ids)

    def step(
        self, action: Array, push: Array | None, env_ids: EnvSelection = ALL, delayed_targets: Array | None = None
    ) -> None:
        """Advance robots by one control period.

        Args:
            action: Joint targets of the policies, clipped, (n, 12), rad.
            push: Pushing forces on the trunks, world frame, (n, 2), N; None to keep the present forces.
            env_ids: Indices of the robots to advance, or a slice.
            delayed_targets: Joint targets that the servos receive, (n, 12), rad; None if they receive `action`.
        """
        if self._has_threads:
            self._check_process()
        self._previous_action[env_ids] = self._action[env_ids]
        self._action[env_ids] = action[env_ids]
        targets = (action if delayed_targets is None else delayed_targets)[env_ids]
        self._ctrl[env_ids] = targets
        if push is not None:
            steady = self._steady_force
            self._push[env_ids] = push[env_ids] if steady is None else push[env_ids] + steady[env_ids]
        if self.meter is not None:
            self.meter.start(env_ids)
        if self._steps_singly:
            self._step_with_models(targets, env_ids)
        else:
            self._step_physics(env_ids, self.substeps)
        if self.meter is not None:
            self.meter.finish(env_ids)
        if self.probe is not None:
            self.probe.refresh(env_ids)
        if self._footsteps is not None:
            self._footsteps.update(env_ids)

    def _step_with_models(self, targets: Array, env_ids: EnvSelection) -> None:
        """Advance robots by a control period, with target filter, thermal model and motor meter.

        `targets` are the joint targets that the servos of the robots `env_ids` receive, (k, 12), rad.
        """
        filtered_targets: Array | None = None
        if self._target_filter is not None:
            filtered_targets = self._target_filter.update(targets, env_ids, self.substeps)
        is_cool = self._thermal_model is None or self._thermal_model.has_cool_motors(env_ids)
        if self._records_all_steps and is_cool and self._step_with_outputs(filtered_targets, env_ids):
            return
        for number in range(self.substeps):
            if filtered_targets is not None:
                self._ctrl[env_ids] = filtered_targets[number]
            self._step_physics(env_ids, 1)
            if self._thermal_model is not None:
                self._thermal_model.update(self._servo_torque[env_ids], env_ids)
            if self.meter is not None:
                self.meter.record(env_ids)

    def _step_with_outputs(self, filtered_targets: Array | None, env_ids: EnvSelection) -> bool:
        """Advance robots by a control period in one call, and record the outputs of its physics steps.

        The call stops stepping a robot with a new warning, and it does not lower the torque limit of a hot motor. In
        both cases the states before the call are restored, because the robots are then stepped one by one.

        Args:
            filtered_targets: Joint targets in each of m physics steps, (m, k, 12), rad; None for constant targets.
            env_ids: Indices of the k robots, or a slice.

        Returns:
            False if the robots were not advanced, because MuJoCo warned or failed, or because a motor became hot.
        """
        is_all = env_ids is ALL
        batch = cast("RecordingBatch", self.batch)
        state = batch.state[env_ids].copy()
        warning = batch.warning[env_ids].copy()
        try:
            outputs = batch.rollout(
                self.substeps,
                None if filtered_targets is None else filtered_targets.swapaxes(0, 1),
                record=self._recorded_fields,
                ids=None if is_all else env_ids,
                out=self._outputs if is_all else None,
            )
        except SimulationError:
            has_finished = False
        else:
            has_finished = np.array_equal(batch.warning[env_ids], warning)
        if has_finished and self._thermal_model is not None:
            torques = outputs["actuator_force"].swapaxes(0, 1)
            has_finished = self._thermal_model.update_cool_motors(torques, env_ids)
        if not has_finished:
            batch.state[env_ids] = state
            batch.warning[env_ids] = warning
            return False
        if is_all:
            self._outputs = outputs
        if self.meter is not None:
            self.meter.record_steps(outputs)
        return True

    def _step_physics(self, env_ids: EnvSelection, count: int) -> None:
        """Advance robots by `count` physics steps; increase the warning count of each robot that MuJoCo cannot step."""
        try:
            self.batch.step(None if env_ids is ALL else env_ids, count)
        except SimulationError as error:
            self._warnings[error.ids] += 1

    def read_coordinates(self, env_ids: EnvSelection | None = ALL) -> tuple[Coordinates[Any], Any]:
        """Read the present generalised coordinates of k robots, and find robots with a diverged simulation.

        A simulation has diverged if MuJoCo has warned since the reset, or if the state is not finite.

        Args:
            env_ids: Indices of k robots, or a slice; None for the only robot of a batch of one.

        Returns:
            coordinates: Copy of the present coordinates, with components (k,), or floats if `env_ids` is None.
            diverged: True for diverged robots, (k,), or a bool if `env_ids` is None.
        """
        components = component_reader(env_ids)
        qpos = components(self.qpos)
        qvel = components(self.qvel)
        has_warning = ordered_sum(components(self._warnings)) > 0
        return (qpos, qvel), has_warning | not_finite(qpos) | not_finite(qvel)

    def reset_diverged(self, env_ids: NDArray[np.intp]) -> None:
        """Put diverged robots into the home pose with zero velocity, so that their states are finite again."""
        self._reset_actuator_models(env_ids)
        self.batch.reset(env_ids, keyframe=0, stage=mujoco.mjtStage.mjSTAGE_ACC.value)
        self._reset_readings(env_ids)

    def state(
        self,
        command: Components[ScalarOrBatch],
        env_ids: EnvSelection | None = ALL,
        coordinates: Coordinates[ScalarOrBatch] | None = None,
    ) -> QuadState[ScalarOrBatch]:
        """Return the present state of k robots.

        Args:
            command: Velocity command that the robots tracked in the last step, (3): forward m/s, lateral m/s, yaw rate
                rad/s.
            env_ids: Indices of k robots, or a slice. None means the only robot of a batch of one; the state then has
                floats.
            coordinates: Present coordinates of the k robots; None to read them.

        Returns:
            State of the k robots, with components (k,), or floats if `env_ids` is None.
        """
        components: ComponentReader[ScalarOrBatch] = component_reader(env_ids)
        qpos, qvel = coordinates or (components(self.qpos), components(self.qvel))
        position = qpos[:3]
        rotation = rotation_matrix(qpos[3:7])
        linear_velocity = qvel[:3]
        angular_velocity = qvel[3:6]
        trunk_contact: Any = False
        for count in self._trunk_contacts:
            trunk_contact = trunk_contact | (components(count)[0] > 0)
        # Arguments by position take a third of the time of arguments by keyword.
        state = QuadState(
            position,
            position[2] - self.terrain.height(position[0], position[1]),
            self.robot.home_height,
            rotation,
            to_body(rotation, linear_velocity),
            angular_velocity,
            heading_velocity(rotation, linear_velocity, angular_velocity),
            linear_velocity[2],
            qpos[7:],
            qvel[6:],
            components(self.torque),
            trunk_contact,
            command,
            components(self._action),
            components(self._previous_action),
            *self._untracked_fields,
        )
        if self._footsteps is None and self.leg_phase is None:
            return state
        return self._with_footsteps(state, env_ids)

    def _with_footsteps(
        self, state: QuadState[ScalarOrBatch], env_ids: EnvSelection | None
    ) -> QuadState[ScalarOrBatch]:
        """Return the `state` of the robots `env_ids` with the tracked footsteps and the phase of the gait clock."""
        components: ComponentReader[ScalarOrBatch] = component_reader(env_ids)
        footsteps = self._footsteps
        if self.leg_phase is not None:
            state = state._replace(leg_phase=components(self.leg_phase))
        if footsteps is None:
            return state
        return state._replace(
            swing_time=components(footsteps.swing_time),
            touchdown_speed=components(footsteps.touchdown_speed),
            foot_contact=component_reader(env_ids)(footsteps.contact),
            foot_height=components(footsteps.clearance),
            foot_speed=components(footsteps.speed),
        )

    @property
    def quaternion(self) -> Array:
        """Quaternion (w, x, y, z) of every trunk from the base frame to the world frame, (n, 4)."""
        return self.qpos[:, 3:7].copy()

    @property
    def push(self) -> Array:
        """Pushing force on every trunk in the last step, except the steady force, world frame, (n, 2), N."""
        return self._push.copy() if self._steady_force is None else self._push - self._steady_force

    @property
    def winding_temperature(self) -> Array | None:
        """Winding temperature of every motor, (n, 12), °C; None if the motors have no thermal model."""
        return None if self._thermal_model is None else self._thermal_model.temperature.copy()

    def ground_contacts(self) -> tuple[Mask, Mask]:
        """Return the ground contacts of the legs in the last physics step.

        Returns:
            feet: True for each foot on the ground, (n, 4).
            links: True for robots with at least one thigh or calf on the ground, (n,).
        """
        links = sum(self._link_contacts, np.zeros((len(self.qpos), 1)))
        return touching(self._foot_contacts, ALL), np.asarray(links[:, 0] > 0)

    def sync_model(self, robot: int) -> None:
        """Write the values of the robot with index `robot` into the fields of `model` that differ between robots."""
        differs = self._payload_position is not None or self._thermal_model is not None or self._has_per_env_models
        if not differs:
            return
        model = self.model
        sensor_stages = model.sensor_needstage.copy()
        start = model.qpos0.copy()
        flags = model.opt.disableflags
        self.batch.get_model(robot, model)
        model.sensor_needstage[:] = sensor_stages
        model.qpos0[:] = start
        model.opt.disableflags = flags

    def snapshot(self, robot: int) -> mujoco.MjData:
        """Return a copy of the MuJoCo data of the robot with the index `robot`, with all derived fields.

        The method also writes the model fields of this robot into the attribute `model`.
        """
        self.sync_model(robot)
        data = self.batch.get_data(robot)
        mujoco.mj_forward(self.model, data)
        return data

    @cached_property
    def drawn_model(self) -> mujoco.MjModel:
        """Model for images: `model`, with the geoms that do not collide and their meshes."""
        return self.model if self._config.visuals else self._compile_model(visuals=True)

    def drawn_snapshot(self, robot: int) -> mujoco.MjData:
        """Return MuJoCo data of `drawn_model` in the state of the robot with the index `robot`."""
        if self._config.visuals:
            return self.snapshot(robot)
        self.sync_model(robot)
        model = self.drawn_model
        for field in _DRAWN_FIELDS:
            getattr(model, field)[:] = getattr(self.model, field)
        drawn = mujoco.MjData(model)
        drawn.qpos[:] = self.qpos[robot]
        drawn.qvel[:] = self.qvel[robot]
        mujoco.mj_forward(model, drawn)
        return drawn


def _count_substeps(control_rate: float, timestep: float) -> int:
    """Return the number of physics steps of `timestep`, s, in a control step at the rate `control_rate`, Hz.

    ValueError is raised if this number is not a whole number.
    """
    period = 1 / control_rate
    substeps = round(period / timestep)
    if substeps < 1 or abs(substeps * timestep - period) > 1e-9:
        raise ValueError(f"at {control_rate} Hz a control step is no whole number of physics steps ({timestep} s)")
    return substeps


def _contact_sensor_names(robot: Robot, model: mujoco.MjModel, config: SimulationConfig) -> _ContactSensorNames:
    """Return the names of the contact sensors that a simulation with the options `config` reads."""
    feet = robot.leg_names if config.has_meter or config.tracks_footsteps else ()
    links = [f"{leg}_{link}" for leg in robot.leg_names for link in _LINKS] if config.has_meter else []
    return _ContactSensorNames(
        trunk=contact_sensors(model, "trunk"),
        feet=[contact_sensors(model, f"{leg}_foot") for leg in feet],
        links=list(chain.from_iterable(contact_sensors(model, link) for link in links)),
    )


def _sensor_names(
    robot: Robot, model: mujoco.MjModel, config: SimulationConfig, contacts: _ContactSensorNames
) -> list[str]:
    """Return the names of all MuJoCo sensors that a simulation with the options `config` reads.

    `contacts` are the names of the contact sensors.
    """
    names = [*contacts.trunk, *chain.from_iterable(contacts.feet), *contacts.links]
    if config.imu is not None:
        names += ideal_sensor_names(robot, model)
    if config.has_meter:
        names += chain.from_iterable(touch_sensors(robot, model))
    return names
