"""What n robots' motors do in a control step: work, heat and extremes, from torques as the joints received them."""

from collections.abc import Callable
from typing import Any

import numpy as np

from quad_env.actuation.models import Actuator
from quad_env.columns import Array, Ids
from quad_env.physics.batch import MUJOCO, Batch
from quad_env.robots.robot import Robot

OF_JOINTS = (
    *("positive_work", "regeneration", "joule_heat", "mean_torque", "peak_torque", "peak_speed", "torque_change"),
)
"""Readings of a `Meter` with a value a joint; see `quad_env.task.readings`."""
Received = Callable[[Ids, Array], Array]
"""Torques that the joints of those robots received in the last physics step, (k, 12), N·m, in which their speeds have
changed by that, (k, 12), rad/s."""


class Meter:
    """Measures what motors and ground do to n robots, physics step by physics step of a control step.

    A step's work is that of the torque received at the mean of the speeds before and after it, since with M (v' − v)
    for the impulse of all forces, impulse · (v + v') / 2 is the change of ½ vᵀ M v.
    """

    def __init__(
        self, robot: Robot, batch: Batch, model: Any, actuator: Actuator, substeps: int, simulator: str = MUJOCO
    ) -> None:
        self._speed = batch.bind("qvel")[:, -robot.num_joints :]
        self._received = received_torque(batch, model, robot.num_joints, simulator)
        self._touch = [batch.sensor(name).data for name in touch_sensors(robot)]
        self._timestep, self._share = model.opt.timestep, 1 / substeps
        line = None if actuator.curve is None else actuator.curve.on(robot)
        self._slope = np.nan if line is None else line.slope
        self.torque_limit = model.actuator_forcerange[:, 1].copy()
        """Of each joint's motor, (12,), N·m."""
        self.speed_limit = np.full(robot.num_joints, robot.rated_speed if line is None else line.no_load_speed)
        """Speed of each joint without load, of motors without a curve the rated one, (12,), rad/s."""
        self._last = np.zeros(self._speed.shape)
        self.readings = {name: np.zeros(self._speed.shape) for name in OF_JOINTS}
        """Of the control step so far, name -> (n, …)."""
        self.readings["foot_impulse"] = np.zeros((len(self._speed), len(self._touch)))

    def begin(self, ids: Ids) -> None:
        """Start those robots, whose motors have not given any torque yet."""
        self._last[ids] = 0.0
        self.clear(ids)

    def clear(self, ids: Ids) -> None:
        """Begin a control step of those robots."""
        for reading in self.readings.values():
            reading[ids] = 0.0

    def advance(self, ids: Ids, count: int, step: Callable[[Ids, int], None]) -> None:
        """Take so many physics steps of those robots, one by one."""
        for _ in range(count):
            before = self._speed[ids].copy()
            step(ids, 1)
            with np.errstate(all="ignore"):  # of a robot that has diverged, which is about to be parked
                self._add(ids, before)

    def _add(self, ids: Ids, before: Array) -> None:
        after, now, time = self._speed[ids], self.readings, self._timestep
        torque = self._received(ids, after - before)
        size, work = np.abs(torque), time * torque * (0.5 * (before + after))
        now["positive_work"][ids] += np.maximum(work, 0.0)
        now["regeneration"][ids] += np.maximum(-work, 0.0)
        now["joule_heat"][ids] += time * torque * torque / self._slope
        now["mean_torque"][ids] += self._share * size
        now["torque_change"][ids] += np.abs(torque - self._last[ids])
        now["peak_torque"][ids] = np.maximum(now["peak_torque"][ids], size)
        now["peak_speed"][ids] = np.maximum(now["peak_speed"][ids], np.abs(after))
        now["foot_impulse"][ids] += time * np.concatenate([force[ids] for force in self._touch], axis=1)
        self._last[ids] = torque


def touch_sensors(robot: Robot) -> list[str]:
    """Names of the sensors of the force that presses each foot."""
    return [f"{leg}_foot_touch" for leg in robot.leg_names]


def received_torque(batch: Batch, model: Any, joints: int, simulator: str) -> Received:
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
