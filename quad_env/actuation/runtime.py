"""What the drives of n robots do between their targets and MuJoCo's motors, at every physics step: lag and heat."""

import math
from collections.abc import Callable

import numpy as np

from quad_env.actuation.models import Actuator, Line, Thermal, weaker
from quad_env.columns import Array, Ids, Mask
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import Motors

Advance = Callable[[Ids, int], None]
"""Moves those robots on by a number of physics steps."""
Bind = Callable[[str], Array]
"""A field of every robot's simulation or model, by MuJoCo's name; writing to it changes the robots."""


class Lag:
    """First-order lag of the targets, exact for a target that is constant over a physics step, as MuJoCo's
    `filterexact`: a motor sees the value at the start of the step."""

    def __init__(self, bandwidth: float, timestep: float, num_envs: int, home: Array) -> None:
        self._home = home
        self._share = 1 - math.exp(-timestep * 2 * math.pi * bandwidth)
        self._value = np.tile(home, (num_envs, 1))

    def begin(self, ids: Ids) -> None:
        """Start those robots at home."""
        self._value[ids] = self._home

    def follow(self, targets: Array, ids: Ids) -> Array:
        """What the motors of those robots go by in the coming physics step, (k, 12), rad, on the way to `targets`."""
        now = self._value[ids].copy()
        self._value[ids] = now + self._share * (targets - now)
        return now


class Windings:
    """Temperatures of n robots' motors, and the torque limits that they leave; see `Thermal`.

    MuJoCo 4.0's `dcmotor` has a thermal model too, but heats by the current before the force range limits it: a motor
    that is derated or off would be heated by a current that it does not carry.

    `force_range`, (n, 12, 2), N·m, is what MuJoCo limits each motor's torque to; it is written here.
    """

    def __init__(self, thermal: Thermal, line: Line, timestep: float, force_range: Array) -> None:
        self._thermal = thermal
        self._rise = thermal.resistance / line.slope
        self._kept = math.exp(-timestep / thermal.time_constant)
        self._force_range, self._full_range = force_range, force_range.copy()
        self.temperature = np.full(force_range.shape[:2], thermal.ambient)
        """(n, 12), °C"""
        self._off: Mask = np.zeros(force_range.shape[:2], np.bool_)

    def begin(self, ids: Ids) -> None:
        """Start those robots with motors that are cold and work."""
        self.temperature[ids], self._off[ids] = self._thermal.ambient, False
        self._force_range[ids] = self._full_range[ids]

    def heat(self, torque: Array, ids: Ids) -> None:
        """A physics step with these torques, (k, 12), N·m, of those robots has passed."""
        thermal = self._thermal
        limit = thermal.ambient + self._rise * (torque * torque)
        temperature = limit + (self.temperature[ids] - limit) * self._kept
        off = self._off[ids] | (temperature >= thermal.shutdown)
        margin = np.clip((thermal.shutdown - temperature) / (thermal.shutdown - thermal.derating), 0.0, 1.0)
        share = np.where(off, 0.0, thermal.derated + (1 - thermal.derated) * margin)
        self.temperature[ids], self._off[ids] = temperature, off
        self._force_range[ids] = self._full_range[ids] * share[..., None]


class ActuatorModels:
    """The drives of n robots, a lag and windings or one of them, around the motors of a batch."""

    def __init__(self, lag: Lag | None, windings: Windings | None, bind: Bind, substeps: int) -> None:
        self._lag, self._windings, self._substeps = lag, windings, substeps
        self._ctrl, self._torque = bind("ctrl"), bind("actuator_force")

    def begin(self, ids: Ids) -> None:
        """Start those robots afresh."""
        if self._lag is not None:
            self._lag.begin(ids)
        if self._windings is not None:
            self._windings.begin(ids)

    def advance(self, targets: Array, ids: Ids, advance: Advance) -> None:
        """A control step of those robots, whose targets these are, (k, 12), rad."""
        for _ in range(self._substeps):
            if self._lag is not None:
                self._ctrl[ids] = self._lag.follow(targets, ids)
            advance(ids, 1)
            if self._windings is not None:
                self._windings.heat(self._torque[ids], ids)

    @property
    def temperature(self) -> Array | None:
        """Temperature of every winding, (n, 12), °C; None without a thermal model."""
        return None if self._windings is None else self._windings.temperature.copy()


def actuator_models_of(
    robot: Robot, motors: Motors, actuator: Actuator, bind: Bind, expand: Bind, substeps: int, timestep: float
) -> ActuatorModels | None:
    """The drives of those motors, or None where MuJoCo's own servos do all that is asked for."""
    curve, thermal, bandwidth = actuator.curve, actuator.thermal, weaker(motors.bandwidth, actuator.bandwidth)
    if curve is None or (thermal is None and bandwidth is None):
        return None
    lag = None if bandwidth is None else Lag(bandwidth, timestep, len(bind("ctrl")), robot.home_pose)
    windings = None if thermal is None else Windings(thermal, curve.on(robot), timestep, expand("actuator_forcerange"))
    return ActuatorModels(lag, windings, bind, substeps)
