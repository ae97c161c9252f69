"""What n robots' motors do in a control step: work, heat and extremes, from torques as the joints received them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from quad_env.actuation.models import Actuator
from quad_env.columns import Array, EnvSelection
from quad_env.physics.batch import MUJOCO, Batch
from quad_env.robots.collision_rules import names_of_part
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
"""Readings of a `Meter` with a value a joint; see `quad_env.task.readings`."""
AppliedTorqueReader = Callable[[EnvSelection, Array], Array]
"""Torques that the joints of those robots received in the last physics step, (k, 12), N·m, in which their speeds have
changed by that, (k, 12), rad/s."""


class MotorMeter:
    """Measures what motors and ground do to n robots in the physics steps of a control step.

    A step's work is that of the torque received at the mean of the speeds before and after it, since with M (v' − v)
    for the impulse of all forces, impulse · (v + v') / 2 is the change of ½ vᵀ M v.
    """

    def __init__(self, robot: Robot, batch: Batch, model: Any, actuator: Actuator, simulator: str = MUJOCO) -> None:
        self._speed = batch.bind("qvel")[:, -robot.num_joints :]
        self._received = make_applied_torque_reader(batch, model, robot.num_joints, simulator)
        self._touch = [[batch.sensor(name).data for name in names] for names in touch_sensors(robot, model)]
        self._timestep = model.opt.timestep
        line = None if actuator.curve is None else actuator.curve.resolve(robot)
        self._slope = np.nan if line is None else line.slope
        self.torque_limit = model.actuator_forcerange[:, 1].copy()
        """Of each joint's motor, (12,), N·m."""
        self.speed_limit = np.full(robot.num_joints, robot.rated_speed if line is None else line.no_load_speed)
        """Speed of each joint without load, of motors without a curve the rated one, (12,), rad/s."""
        self._steps: list[tuple[Array, ...]] = []
        """Speeds before and after each physics step of this control step, torques, forces on the feet."""
        self._torque = np.zeros(self._speed.shape)
        """Mean of the last control step, N·m."""
        self.readings = {name: np.zeros(self._speed.shape) for name in JOINT_READINGS}
        """Of the last control step, name -> (n, …)."""
        self.readings["foot_impulse"] = np.zeros((len(self._speed), len(robot.leg_names)))

    def reset(self, ids: EnvSelection) -> None:
        """Start those robots, whose motors have not done anything yet."""
        for values in (self._torque, *self.readings.values()):
            values[ids] = 0.0

    def advance(self, ids: EnvSelection, count: int, step: Callable[[EnvSelection, int], None]) -> None:
        """Take so many physics steps of those robots, one by one."""
        for _ in range(count):
            before = self._speed[ids].copy()
            step(ids, 1)
            after = self._speed[ids].copy()
            force = summed(self._touch, ids)
            with np.errstate(all="ignore"):  # of a robot that has diverged, which is about to be parked
                self._steps.append((before, after, self._received(ids, after - before), force))

    def finish(self, ids: EnvSelection) -> None:
        """Work out the readings of the control step that those robots have just made."""
        before, after, torque, force = (np.array(each) for each in zip(*self._steps, strict=True))
        self._steps.clear()
        with np.errstate(all="ignore"):
            time, size, mean = self._timestep, np.abs(torque), torque.mean(axis=0)
            work = time * torque * (0.5 * (before + after))
            found = {
                "positive_work": np.maximum(work, 0.0).sum(axis=0),
                "regeneration": np.maximum(-work, 0.0).sum(axis=0),
                "joule_heat": time * (torque * torque).sum(axis=0) / self._slope,
                "mean_torque": size.mean(axis=0),
                "peak_torque": size.max(axis=0),
                "peak_speed": np.abs(after).max(axis=0),
                "torque_change": np.abs(mean - self._torque[ids]),
                "foot_impulse": time * force.sum(axis=0),
            }
        self._torque[ids] = mean
        for name, values in found.items():
            self.readings[name][ids] = values


def touch_sensors(robot: Robot, model: Any) -> list[list[str]]:
    """Return the names of the force sensors of each foot: one for each of its bodies."""
    if not robot.imported:
        return [[f"{leg}_foot_touch"] for leg in robot.leg_names]
    names = [model.sensor(number).name for number in range(model.nsensor)]
    return [names_of_part(f"{leg}_foot_touch", names) for leg in robot.leg_names]


def summed(touch: Sequence[Sequence[Array]], ids: EnvSelection) -> Array:
    """Return the ground force on each foot of those robots, (k, 4), N, from the sensor data of each foot."""
    return np.concatenate([np.sum([each[ids] for each in data], axis=0) for data in touch], axis=1)


def make_applied_torque_reader(batch: Batch, model: Any, joints: int, simulator: str) -> AppliedTorqueReader:
    """Gives the torques that the joints received in a physics step; MuJoCo's `actuator_force` is not yet these.

    MuJoCo's implicit integration solves (M − h D) (v' − v) = h (all forces at v), so that the joints receive the
    explicit torque and D (v' − v), of which the joints' own damping is not the motors'. D, `qDeriv`, leaves out the
    motors that are at their limit.
    """
    explicit = batch.bind("actuator_force")
    if simulator != MUJOCO:
        return lambda ids, _: explicit[ids]
    derivative = batch.bind("qDeriv")
    diagonal = (model.D_rowadr + model.D_diag)[-joints:]
    damping = model.dof_damping[-joints:].copy()
    return lambda ids, change: explicit[ids] + (derivative[ids][:, diagonal] + damping) * change
