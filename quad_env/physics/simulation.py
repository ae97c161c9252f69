"""n robots on one batch of a simulator: joint targets in, state out."""

import itertools
import os
from collections.abc import Iterable, Sequence
from typing import Any, cast

import mujoco
import numpy as np
from mujoco.batch import SimulationError
from numpy.typing import NDArray

from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.actuation.runtime import actuator_models_of
from quad_env.columns import (
    Array,
    Components,
    EnvIndices,
    EnvSelection,
    Mask,
    ScalarOrBatch,
    not_finite,
    ordered_sum,
    to_components,
    to_scalars,
)
from quad_env.physics.batch import DRAKE, MUJOCO, check_simulator, make_batch
from quad_env.physics.energy import MotorMeter, touch_sensors
from quad_env.physics.footsteps import Columns, FootContactTracker, touching
from quad_env.physics.model import (
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
from quad_env.physics.state import QuadState, heading_velocity, rotation_matrix, to_body
from quad_env.robots.kinematics import foot_depths
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG
from quad_env.scenarios.randomisation import RandomizationSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, Slope, SmoothRandom

ALL = slice(None)
_DIVERGENCE = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADCTRL) + 1)
"""MuJoCo's warnings of a bad position, velocity, acceleration or control, which follow each other."""
_LINKS = ("thigh", "calf")
_HIGH = 10.0
"""How far up robots of users are looked at before they are put on bumpy ground, leg lengths: with a trunk of many geoms
in the ground MuJoCo finds more contacts than it has memory for."""


class Simulation:
    """State of n robots, stepped together on `nthread` threads; results do not depend on n or the threads.

    With `contacts` the ground contacts of feet and legs are sensed too, see `ground_contacts`, and a `meter` measures
    the motors; with an `imu`, mounted there, there is a `probe`; with `feet` their swings are part of the state. Servos
    have the gains of the robot, or each robot's `servo` its own, stiffness and damping, (2, n, 12). Every `simulator`
    has MuJoCo's fields and conventions, see `quad_env.physics.batch`.
    """

    def __init__(
        self,
        robot: Robot,
        scenario: Scenario,
        num_envs: int,
        nthread: int,
        control_rate: float,
        contacts: bool = False,
        actuator: Actuator = ACTUATORS["ideal"],
        imu: Mounting | None = None,
        feet: bool = False,
        timestep: float | None = None,
        solver_iterations: int | None = None,
        servo: Array | None = None,
        simulator: str = MUJOCO,
    ) -> None:
        check_simulator(simulator, scenario, actuator, sensors=imu is not None, readings=contacts)
        if simulator == DRAKE and servo is not None:
            raise ValueError(f"the simulator {simulator} knows no servo gains that differ from robot to robot")
        self.robot, self.terrain = robot, scenario.terrain
        self.model = compile_model(robot, scenario, actuator, timestep, solver_iterations)
        """Model of every robot, but for its payload's place, what its hot motors can do and what is randomised: there
        it is that of the robot that `show_load` named last."""
        if imu is not None:
            mount_imu(self.model, imu)
        period = 1 / control_rate
        self.substeps = round(period / self.model.opt.timestep)
        if self.substeps < 1 or abs(self.substeps * self.model.opt.timestep - period) > 1e-9:
            raise ValueError(
                f"at {control_rate} Hz a control step is no whole number of physics steps ({self.model.opt.timestep} s)"
            )
        trunk = contact_sensors(self.model, "trunk")
        soles = [contact_sensors(self.model, f"{leg}_foot") for leg in robot.leg_names if contacts or feet]
        links = [contact_sensors(self.model, f"{leg}_{link}") for leg in robot.leg_names for link in _LINKS if contacts]
        read = [
            *trunk,
            *itertools.chain(*soles, *links),
            *(() if imu is None else ideal_sensor_names(robot, self.model)),
        ]
        read += itertools.chain(*touch_sensors(robot, self.model)) if contacts else []
        self._process = os.getpid()
        self._threaded = nthread > 1
        self.batch = make_batch(simulator, make_stepping_model(self.model, read), num_envs, nthread)
        """The robots as the simulator steps them."""
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        """Positions, (n, 19), and velocities, (n, 18), in MuJoCo's order; what is written there moves the robots."""
        self._ctrl = self.batch.bind("ctrl")
        self._push = self.batch.bind("xfrc_applied")[:, self.model.body("base_link").id, :2]
        self.torque = self.batch.bind("actuator_force")
        """Torques of the servos in the last physics step, (n, 12), N·m."""
        self.meter = MotorMeter(robot, self.batch, self.model, actuator, simulator) if contacts else None
        self.probe = None if imu is None else IdealSensors(robot, self.batch, self.model, period)
        if self.probe is not None:  # which computes the outputs of the last substep again
            self.torque = self.probe.copy(self.torque)
        self._trunk_contacts = self._sensed(trunk)
        self._foot_contacts = [self._sensed(names) for names in soles]
        self._link_contacts = self._sensed(itertools.chain(*links))
        self._warnings = self.batch.warning[:, _DIVERGENCE, 1]
        self._feet = [self.model.site(f"{leg}_foot").id for leg in robot.leg_names]
        ends = [joint for joint in range(robot.num_joints) if joint % JOINTS_PER_LEG]
        self._thighs = [self.model.joint(robot.joint_names[joint]).id for joint in ends]
        self._corners = trunk_corners(self.model)
        bumpy = isinstance(self.terrain, SmoothRandom | HeightField)
        self._spawn_clearance = _HIGH * robot.leg_length if robot.imported and bumpy else 0.0
        if isinstance(self.terrain, HeightField):  # which may be anywhere, and of many small cells
            self._spawn_clearance += self.terrain.heights.lowest + self.terrain.heights.span
        self._has_per_env_models = servo is not None or scenario.randomisation is not None
        if servo is not None:
            give_servo_gains(self.model, self.batch.expand, servo)
        self._sites, self._joints = self.batch.bind("site_xpos"), self.batch.bind("xanchor")
        self._footsteps = FootContactTracker(period, self._foot_contacts, self._sites, self._feet) if feet else None
        self._filtered = self.batch.bind("act") if self.model.na else None
        load = None if scenario.payload is None else self.model.body(PAYLOAD).id
        self._load = None if load is None else self.batch.expand("body_pos")[:, load, :2]
        self._history = self.batch.bind("history") if self.model.nhistory else None
        self._initial_history = initial_actuator_history(self.model, robot.home_pose) if self.model.nhistory else None
        rows, timestep = (self.batch.bind, self.batch.expand), self.model.opt.timestep
        self._actuators = actuator_models_of(robot, scenario.motors, actuator, *rows, self.substeps, timestep)
        self._randomised = None
        if scenario.randomisation is not None:
            limits = None if self._actuators is None else self._actuators.full_range
            self._randomised = RandomisedModels(self.model, self.batch.expand, limits)
        self._force: Array | None = None
        self._alignment = slope_quaternion(self.terrain) if isinstance(self.terrain, Slope) else None
        self._action = np.tile(robot.home_pose, (num_envs, 1))
        self._previous_action = self._action.copy()

    def reset(
        self,
        env_ids: EnvIndices,
        rows: Array,
        force: Array | None = None,
        load: Array | None = None,
        randomization: Sequence[RandomizationSample] = (),
    ) -> None:
        """Start the robots `ids` (sorted) from the given start rows, see `episode.draw_start`, just on the ground.

        A row holds x, y, yaw, roll, pitch, 12 joint offsets from home, 6 trunk and 12 joint velocities. `force`,
        (k, 2), N, acts on their trunks at every step, world frame; `load`, (k, 2), m, is where their payloads are, base
        frame; `drawn`, k or none, are figures that differ from episode to episode.
        """
        self._check_process()
        robot = self.robot
        self.batch.reset(env_ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.batch.warning[env_ids] = 0
        qpos = np.empty((len(env_ids), self.model.nq))
        qpos[:, 0:2], qpos[:, 2] = rows[:, 0:2], robot.home_height
        qpos[:, 3:7] = quaternion(rows[:, 3], rows[:, 4], rows[:, 2])
        if self._alignment is not None:
            for orientation in qpos[:, 3:7]:
                mujoco.mju_mulQuat(orientation, self._alignment, orientation.copy())
        offsets, velocities = np.split(rows[:, 5:], [robot.num_joints], axis=1)
        qpos[:, 7:] = np.clip(robot.home_pose + offsets, robot.joint_lower, robot.joint_upper)
        self.qpos[env_ids] = qpos
        self.qvel[env_ids] = velocities
        self._ctrl[env_ids] = self._action[env_ids] = self._previous_action[env_ids] = robot.home_pose
        if self._filtered is not None:
            self._filtered[env_ids] = robot.home_pose
        if self._history is not None:
            self._history[env_ids] = self._initial_history
        if self._randomised is not None and randomization:
            self._randomised.reset(env_ids, randomization)
        if self._actuators is not None:
            self._actuators.reset(env_ids)
        if force is not None:
            self._force = np.zeros_like(self._push) if self._force is None else self._force
            self._force[env_ids] = self._push[env_ids] = force
        if self._load is not None:
            self._load[env_ids] = 0.0 if load is None else load
        if self._load is not None or self._randomised is not None:
            self.batch.set_const(env_ids)
        qpos[:, 2] += self._spawn_clearance
        self.qpos[env_ids, 2] = qpos[:, 2]
        self.batch.forward(env_ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        self.qpos[env_ids, 2] += self._penetration_correction(env_ids, qpos)
        self._begin_readings(env_ids)

    def _check_process(self) -> None:
        """Raise RuntimeError in a forked process: it has no threads of the batch, so it would wait for ever."""
        if self._threaded and os.getpid() != self._process:
            raise RuntimeError(
                f"this batch has threads of process {self._process}, which a fork, {os.getpid()}, does not have: make "
                "it in the process that steps it, start processes by spawn, or give nthread=1"
            )

    def _begin_readings(self, env_ids: EnvSelection) -> None:
        """Nothing has happened to those robots yet."""
        if self._footsteps is not None:
            self._footsteps.reset(env_ids)
        if self.meter is not None:
            self.meter.reset(env_ids)
        if self.probe is not None:
            self.probe.refresh(env_ids)

    def _penetration_correction(self, env_ids: NDArray[np.intp], qpos: Array) -> Array:
        """How far up those robots, (k, 19), have to go for nothing of them to be below the ground, (k,), m."""
        rotation = np.stack([np.stack(row, -1) for row in rotation_matrix(to_components(qpos[:, 3:7]))], 1)  # (k, 3, 3)
        corners = qpos[:, None, :3] + self._corners @ rotation.transpose(0, 2, 1)
        feet = self._sites[env_ids][:, self._feet]
        thighs = self._joints[env_ids][:, self._thighs]
        below = foot_depths(self.robot, rotation, qpos[:, 7:]) - self.robot.foot_radius
        balls = ((feet, self.robot.foot_radius, below), (thighs, self.robot.thigh_radius, 0.0), (corners, 0.0, 0.0))
        lifts = [
            self.terrain.sphere_center_height(at[:, :, 0], at[:, :, 1], radius) - at[:, :, 2] + deeper
            for at, radius, deeper in balls
        ]
        return cast("Array", np.concatenate(lifts, axis=1).max(axis=1))

    def step(
        self, action: Array, push: Array | None, env_ids: EnvSelection = ALL, delayed_targets: Array | None = None
    ) -> None:
        """Advance those robots by one control period with joint targets (n, 12) and trunk forces (n, 2), N, of all.

        None instead of forces leaves them as they are: since the reset, without any push. `received` are the
        targets that the servos hear, (n, 12), where they are not those of the action.
        """
        self._check_process()
        self._previous_action[env_ids] = self._action[env_ids]
        self._action[env_ids] = action[env_ids]
        targets = (action if delayed_targets is None else delayed_targets)[env_ids]
        self._ctrl[env_ids] = targets
        if push is not None:
            self._push[env_ids] = push[env_ids] if self._force is None else push[env_ids] + self._force[env_ids]
        if self._actuators is None:
            self._advance(env_ids, self.substeps)
        else:
            self._actuators.advance(targets, env_ids, self._advance)
        if self.meter is not None:
            self.meter.finish(env_ids)
        if self.probe is not None:
            self.probe.refresh(env_ids)
        if self._footsteps is not None:
            self._footsteps.advance(env_ids)

    def _advance(self, env_ids: EnvSelection, substeps: int) -> None:
        if self.meter is None:
            self._step(env_ids, substeps)
        else:
            self.meter.advance(env_ids, substeps, self._step)

    def _step(self, env_ids: EnvSelection, substeps: int) -> None:
        try:
            self.batch.step(None if env_ids is ALL else env_ids, substeps)
        except SimulationError as error:
            self._warnings[error.ids] += 1

    def diverged(self, env_ids: EnvSelection | None = ALL) -> Any:
        """Which of those robots' simulations MuJoCo warned about since their reset, or whose state is not finite: a
        column of truth values, of the only robot of a batch of one for None."""
        columns = _columns_of(env_ids)
        warned = ordered_sum(columns(self._warnings)) > 0
        return warned | not_finite(columns(self.qpos)) | not_finite(columns(self.qvel))

    def reset_diverged(self, env_ids: NDArray[np.intp]) -> None:
        """Put diverged robots into the home pose at the origin, at rest, so that every reading is finite."""
        if self._actuators is not None:
            self._actuators.reset(env_ids)
        self.batch.reset(env_ids, keyframe=0, stage=mujoco.mjtStage.mjSTAGE_ACC.value)
        self._begin_readings(env_ids)

    def state(self, command: Components[ScalarOrBatch], env_ids: EnvSelection | None = ALL) -> QuadState[ScalarOrBatch]:
        """Readings of those robots now, as floats of the only robot of a batch of one for None; `command`, (3), is the
        one they were following."""
        columns: Columns[ScalarOrBatch] = _columns_of(env_ids)
        qpos, qvel = columns(self.qpos), columns(self.qvel)
        rotation = rotation_matrix(qpos[3:7])
        x, y, z = qpos[:3]
        return QuadState(
            position=qpos[:3],
            height=z - self.terrain.height(x, y),
            standing_height=self.robot.home_height,
            rotation=rotation,
            linear_velocity=to_body(rotation, qvel[:3]),
            angular_velocity=qvel[3:6],
            heading_velocity=heading_velocity(rotation, qvel[:3], qvel[3:6]),
            vertical_velocity=qvel[2],
            joint_position=qpos[7:],
            joint_velocity=qvel[6:],
            joint_torque=columns(self.torque),
            trunk_contact=ordered_sum(columns(found)[0] for found in self._trunk_contacts) > 0,
            command=command,
            action=columns(self._action),
            previous_action=columns(self._previous_action),
            swing_time=None if self._footsteps is None else columns(self._footsteps.swing_time),
            touchdown_speed=None if self._footsteps is None else columns(self._footsteps.touchdown_speed),
        )

    @property
    def quaternion(self) -> Array:
        """Orientation of every trunk in the world frame, (n, 4), w x y z."""
        return self.qpos[:, 3:7].copy()

    @property
    def push(self) -> Array:
        """Pushing force on every trunk during the last step, world frame, x and y, (n, 2), N; no steady one."""
        return self._push.copy() if self._force is None else self._push - self._force

    @property
    def winding_temperature(self) -> Array | None:
        """Winding temperature of every motor, (n, 12), °C; None where motors have no thermal model."""
        return None if self._actuators is None else self._actuators.temperature

    def ground_contacts(self) -> tuple[Mask, Mask]:
        """Whether each foot, (n, 4), and whether a thigh or calf, (n,), touched the ground in the last substep."""
        links = sum(self._link_contacts, np.zeros((len(self.qpos), 1)))
        return touching(self._foot_contacts, ALL), np.asarray(links[:, 0] > 0)

    def _sensed(self, names: Iterable[str]) -> list[Array]:
        """What contact sensors of those names found in the last substep, (n, 1) each."""
        found = [self.batch.sensor(name).data for name in names]
        return found if self.probe is None else [self.probe.copy(each) for each in found]

    def sync_model(self, robot: int) -> None:
        """Make `model` that of this robot, whose payload, hot motors and randomised figures are its own."""
        if self._load is not None or self.winding_temperature is not None or self._has_per_env_models:
            stages, start = self.model.sensor_needstage.copy(), self.model.qpos0.copy()
            flags = self.model.opt.disableflags
            self.batch.get_model(robot, self.model)
            self.model.sensor_needstage[:], self.model.qpos0[:], self.model.opt.disableflags = stages, start, flags

    def snapshot(self, robot: int) -> mujoco.MjData:
        """A copy of one robot's simulation with every derived field current, to be looked at with `model`."""
        self.sync_model(robot)
        data = self.batch.get_data(robot)
        mujoco.mj_forward(self.model, data)
        return data


def _columns_of(env_ids: EnvSelection | None) -> Columns[Any]:
    return to_scalars if env_ids is None else lambda rows: to_components(rows[env_ids])
