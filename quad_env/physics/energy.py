"""Meter of the work, heat, torques and speeds of motors, and of foot impulses, over a control step."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from quad_env.actuation.models import Actuator
from quad_env.columns import Array, EnvSelection
from quad_env.physics.batch import Batch
from quad_env.robots.part_names import names_of_part
from quad_env.robots.robot import Robot

JOINT_READINGS = (
    "positive_work",
    "regeneration",
    "joule_heat",
    "mean_torque",
    "peak_torque",
    "peak_speed",
    "torque_change",
)
"""Names of the measurements of a `MotorMeter` that have one value per joint.

`quad_env.task.readings` explains the measurements and gives their units.
"""
StepOutputs = Mapping[str, Array]
"""Type of MuJoCo's outputs of physics steps: name of a field in `MotorMeter.outputs` -> values, (..., size)."""
AppliedTorqueReader = Callable[[StepOutputs, Array], Array]
"""Type of a function that returns the joint torques in physics steps, (..., 12), N·m.

The arguments of the function are the outputs of the physics steps, and the change of the joint velocities in each
physics step, (..., 12), rad/s.
"""


class SubstepSample(NamedTuple):
    """Measurements of motors and foot forces of k robots in one physics step."""

    speed_before: Array
    """Joint velocities before the physics step, (k, 12), rad/s."""
    speed_after: Array
    """Joint velocities after the physics step, (k, 12), rad/s."""
    torque: Array
    """Torques that the joints received in the physics step, (k, 12), N·m."""
    foot_force: Array
    """Sum of the normal forces on each foot from its touch sensors, (k, 4), N."""


class MotorMeter:
    """Meter of motors and foot forces of n robots, which samples every physics step of a control step.

    The simulation calls `start` before the physics steps of a control step, and `finish` at the end. It calls `record`
    after each physics step, or `record_steps` after all of them.

    The work of a physics step is the torque times the duration times the mean of the speeds v before and v' after the
    step. This formula is exact: the impulse of all forces is M (v' − v), with the inertia matrix M. The product of this
    impulse with (v + v') / 2 is the change of the kinetic energy ½ vᵀ M v.
    """

    def __init__(self, robot: Robot, batch: Batch, model: Any, actuator: Actuator) -> None:
        self._joints = slice(-robot.num_joints, None)
        self._speed = batch.bind("qvel")[:, self._joints]
        self._applied_torque = make_applied_torque_reader(batch, model, robot.num_joints)
        fields = ("actuator_force", "qDeriv") if batch.features.implicit_damping else ("actuator_force",)
        self._bound = {field: batch.bind(field) for field in fields}
        """Name of an output of MuJoCo for the applied torques -> values in the last physics step, (n, size)."""
        self.outputs = ("qvel", *fields, "sensordata")
        """Names of the MuJoCo fields that `record_steps` needs of every physics step."""
        self._model = model
        self._touch_sensors = touch_sensors(robot, model)
        self._touch = [[batch.sensor(name).data for name in names] for names in self._touch_sensors]
        self._timestep = model.opt.timestep
        curve = None if actuator.curve is None else actuator.curve.resolve(robot)
        self._slope = np.nan if curve is None else curve.slope
        self.torque_limit = model.actuator_forcerange[:, 1].copy()
        """Torque limit of each motor, (12,), N·m."""
        self.speed_limit = np.full(robot.num_joints, robot.rated_speed if curve is None else curve.no_load_speed)
        """No-load speed of each joint, (12,), rad/s; the rated speed for motors without a torque-speed curve."""
        self._speed_before = self._speed.copy()
        """Joint velocities before the next physics step of the k robots that `start` selected, (k, 12), rad/s."""
        self._samples: list[SubstepSample] = []
        """Measurements in each physics step since the last call of `start`."""
        self._mean_torque = np.zeros(self._speed.shape)
        """Signed mean of each joint's torque over the last control step, (n, 12), N·m."""
        self.readings = {name: np.zeros(self._speed.shape) for name in JOINT_READINGS}
        """Name of a measurement -> values in the last control step, (n, 12), or (n, 4) for `foot_impulse`."""
        self.readings["foot_impulse"] = np.zeros((len(self._speed), len(robot.leg_names)))

    def reset(self, env_ids: EnvSelection) -> None:
        """Set all measurements of the robots `env_ids` to zero, at the start of an episode."""
        for values in (self._mean_torque, *self.readings.values()):
            values[env_ids] = 0.0

    def start(self, env_ids: EnvSelection) -> None:
        """Start the measurement of a control step of the robots `env_ids`, before its first physics step."""
        self._samples.clear()
        self._speed_before = self._speed[env_ids].copy()

    def record(self, env_ids: EnvSelection) -> None:
        """Record speeds, torques and foot forces in the last physics step of the robots `env_ids`."""
        before = self._speed_before
        after = self._speed[env_ids].copy()
        force = sum_foot_forces(self._touch, env_ids)
        outputs = {field: values[env_ids] for field, values in self._bound.items()}
        with np.errstate(all="ignore"):  # A diverged robot may have infinite or NaN values.
            torque = self._applied_torque(outputs, after - before)
        self._samples.append(SubstepSample(before, after, torque, force))
        self._speed_before = after

    @cached_property
    def _touch_columns(self) -> list[list[slice]]:
        """For each foot, the columns of its touch sensors in MuJoCo's `sensordata`."""
        addresses = [[int(self._model.sensor(name).adr[0]) for name in names] for names in self._touch_sensors]
        return [[slice(address, address + 1) for address in foot] for foot in addresses]

    def record_steps(self, outputs: StepOutputs) -> None:
        """Record speeds, torques and foot forces in all physics steps of a control step, instead of `record`.

        Args:
            outputs: Name of a field in `outputs` -> values of k robots in each of m physics steps, (k, m, size).
        """
        after = outputs["qvel"].swapaxes(0, 1)[..., self._joints]
        before = np.concatenate((self._speed_before[None], after[:-1]))
        steps = {field: outputs[field].swapaxes(0, 1) for field in self._bound}
        sensors = outputs["sensordata"].swapaxes(0, 1)
        force = _concatenate_feet([[sensors[..., column] for column in feet] for feet in self._touch_columns])
        with np.errstate(all="ignore"):  # A diverged robot may have infinite or NaN values.
            torque = self._applied_torque(steps, after - before)
        self._samples += map(SubstepSample, before, after, torque, force)

    def finish(self, env_ids: EnvSelection) -> None:
        """Compute the measurements of a control step of the robots `env_ids` from its physics steps."""
        before, after, torque, force = (np.array(values) for values in zip(*self._samples, strict=True))
        time = self._timestep
        with np.errstate(all="ignore"):
            magnitude = np.abs(torque)
            mean = torque.mean(axis=0)
            work = time * torque * (0.5 * (before + after))
            readings = {
                "positive_work": np.maximum(work, 0.0).sum(axis=0),
                "regeneration": np.maximum(-work, 0.0).sum(axis=0),
                "joule_heat": time * (torque * torque).sum(axis=0) / self._slope,
                "mean_torque": magnitude.mean(axis=0),
                "peak_torque": magnitude.max(axis=0),
                "peak_speed": np.abs(after).max(axis=0),
                "torque_change": np.abs(mean - self._mean_torque[env_ids]),
                "foot_impulse": time * force.sum(axis=0),
            }
        self._mean_torque[env_ids] = mean
        for name, values in readings.items():
            self.readings[name][env_ids] = values


def touch_sensors(robot: Robot, model: Any) -> list[list[str]]:
    """Return the names of the touch (normal force) sensors of each foot, which may have several bodies.

    Args:
        robot: Robot of the model.
        model: Compiled `mujoco.MjModel`.

    Returns:
        Names of the sensors, one list per foot with one sensor per body.
    """
    if not robot.imported:
        return [[f"{leg}_foot_touch"] for leg in robot.leg_names]
    names = [model.sensor(number).name for number in range(model.nsensor)]
    return [names_of_part(f"{leg}_foot_touch", names) for leg in robot.leg_names]


def sum_foot_forces(touch: Sequence[Sequence[Array]], env_ids: EnvSelection) -> Array:
    """Compute the ground force on each foot as the sum of the readings of its touch sensors.

    Args:
        touch: For each foot, the readings of its sensors, (n, 1) per sensor, N.
        env_ids: Indices of k robots, or a slice.

    Returns:
        Ground force on each foot, (k, 4), N.
    """
    return _concatenate_feet([[force[env_ids] for force in forces] for forces in touch])


def _concatenate_feet(touch: Sequence[Sequence[Array]]) -> Array:
    """Return the ground force on each foot, (..., 4), N; `touch` are the forces of its sensors, (..., 1) each."""
    # The force of a foot with one sensor is read without a sum, because a sum takes as long as all other readings.
    feet = [forces[0] if len(forces) == 1 else np.sum(forces, axis=0) for forces in touch]
    return np.concatenate(feet, axis=-1)


def make_applied_torque_reader(batch: Batch, model: Any, num_joints: int) -> AppliedTorqueReader:
    """Create a function that returns the torques that the joints received in the last physics step.

    MuJoCo's implicit integration solves (M − h D) (v' − v) = h f(v). M is the inertia matrix, h the time step, f the
    force, and D = df/dv its derivative. v and v' are the velocities before and after the step. So the joints receive
    the explicit torque, `actuator_force`, and the implicit torque D (v' − v). D is MuJoCo's field `qDeriv`. D includes
    the passive damping of the joints, which is removed here because it is no motor torque. D does not include the
    damping of motors that are at their torque limit.

    Args:
        batch: Batch of the robots.
        model: Compiled `mujoco.MjModel`.
        num_joints: Number of joints; the joints are the last degrees of freedom of the model.

    Returns:
        Function of the outputs of physics steps and of the change of the joint velocities in each of them, (..., 12),
        rad/s; it returns the torques, (..., 12), N·m.
    """
    if not batch.features.implicit_damping:
        return lambda outputs, _: outputs["actuator_force"]
    diagonal = (model.D_rowadr + model.D_diag)[-num_joints:]
    damping = model.dof_damping[-num_joints:].copy()

    def read(outputs: StepOutputs, change: Array) -> Array:
        derivative = outputs["qDeriv"][..., diagonal]
        torque: Array = outputs["actuator_force"] + (derivative + damping) * change
        return torque

    return read
