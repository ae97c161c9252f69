"""From n robots' targets to MuJoCo's motors: delay and drop-outs, then the drives' lag and heat."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.actuation.models import Actuator, ResolvedTorqueSpeed, Thermal, min_limit
from quad_env.columns import Array, EnvIndices, EnvSelection, Mask
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.episode import EpisodeSample, control_steps
from quad_env.scenarios.scenario import Scenario

Advance = Callable[[EnvSelection, int], None]
"""Moves those robots on by a number of physics steps."""
Bind = Callable[[str], Array]
"""A field of every robot's simulation or model, by MuJoCo's name; writing to it changes the robots."""


class ActionDelay:
    """The way of the targets from n policies to the servos; `clock` is each robot's control steps since its start."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        self._home = robot.home_pose
        self._late = np.zeros(num_envs, np.int64)
        self._target_buffer = np.zeros((_max_delay_steps(scenario, dt) + 1, num_envs, robot.num_joints))
        """Targets of the last steps: that of clock c is at c modulo its length."""
        self._received = np.zeros((num_envs, robot.num_joints))
        dropouts = scenario.dropouts
        count = 0 if dropouts is None else dropouts.count
        self._lost_from = np.zeros((num_envs, count), np.int64)
        self._lost_for = 0 if dropouts is None else control_steps(dropouts.duration, dt)
        self._lost_joint = np.zeros((num_envs, count), np.int64)

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots, their servos at home."""
        self._target_buffer[:, env_ids] = self._received[env_ids] = self._home
        for row, episode in zip(env_ids, episodes, strict=True):
            self._late[row] = episode.action_delay
            if episode.dropouts is not None:
                self._lost_from[row], self._lost_joint[row] = episode.dropouts

    def received(self, targets: Array, clock: NDArray[np.int64], env_ids: EnvIndices) -> Array:
        """Targets that the servos go by in the coming step, of all robots, (n, 12), rad; those of `rows` move on.

        `targets`, (n, 12), rad, are what the policies ask for now; `clock`, (k,), is that of `rows`.
        """
        slots = len(self._target_buffer)
        self._target_buffer[clock % slots, env_ids] = targets[env_ids]
        arriving = self._target_buffer[(clock - self._late[env_ids]) % slots, env_ids]
        if self._lost_for:
            self._received[env_ids] = np.where(self._dropout_mask(clock, env_ids), self._received[env_ids], arriving)
        else:
            self._received[env_ids] = arriving
        return self._received

    def _dropout_mask(self, clock: NDArray[np.int64], env_ids: EnvIndices) -> Mask:
        """Which joints of those robots hear nothing in the coming step, (k, 12)."""
        since = clock[:, None] - self._lost_from[env_ids]
        lost = np.zeros((len(env_ids), self._received.shape[1]), np.bool_)
        robot, event = np.nonzero((since >= 0) & (since < self._lost_for))
        lost[robot, self._lost_joint[env_ids[robot], event]] = True
        return lost


def action_delay_of(robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> ActionDelay | None:
    """The robots' action_delay, or None where targets reach the servos at once and always."""
    lost = scenario.dropouts is not None and scenario.dropouts.count > 0
    return ActionDelay(robot, scenario, num_envs, dt) if lost or _max_delay_steps(scenario, dt) else None


def _max_delay_steps(scenario: Scenario, dt: float) -> int:
    """Control steps of the longest delay of actions."""
    latency, randomisation = scenario.latency, scenario.randomisation
    delays = 0.0 if latency is None else latency.action, 0.0 if randomisation is None else randomisation.delay
    return sum(round(delay / dt) for delay in delays)


class FirstOrderFilter:
    """First-order lag of the targets, exact for a target that is constant over a physics step, as MuJoCo's
    `filterexact`: a motor sees the value at the start of the step."""

    def __init__(self, bandwidth: float, timestep: float, num_envs: int, home: Array) -> None:
        self._home = home
        self._share = 1 - math.exp(-timestep * 2 * math.pi * bandwidth)
        self._value = np.tile(home, (num_envs, 1))

    def reset(self, ids: EnvSelection) -> None:
        """Start those robots at home."""
        self._value[ids] = self._home

    def follow(self, targets: Array, ids: EnvSelection) -> Array:
        """What the motors of those robots go by in the coming physics step, (k, 12), rad, on the way to `targets`."""
        now = self._value[ids].copy()
        self._value[ids] = now + self._share * (targets - now)
        return now


class MotorThermalModel:
    """Temperatures of n robots' motors, and the torque limits that they leave; see `Thermal`.

    MuJoCo 4.0's `dcmotor` heats by the current before the force range limits it, which a motor that is off does not
    carry. `force_range`, (n, 12, 2), N·m, is what MuJoCo limits each motor's torque to; it is written here.
    """

    def __init__(self, thermal: Thermal, line: ResolvedTorqueSpeed, timestep: float, force_range: Array) -> None:
        self._thermal = thermal
        self._rise = thermal.resistance / line.slope
        self._kept = math.exp(-timestep / thermal.time_constant)
        self._force_range, self.full_range = force_range, force_range.copy()
        """Of cold motors, (n, 12, 2), N·m; what is written there holds from the next start on."""
        self.temperature = np.full(force_range.shape[:2], thermal.ambient)
        """(n, 12), °C"""
        self._off: Mask = np.zeros(force_range.shape[:2], np.bool_)

    def reset(self, ids: EnvSelection) -> None:
        """Start those robots with motors that are cold and work."""
        self.temperature[ids], self._off[ids] = self._thermal.ambient, False
        self._force_range[ids] = self.full_range[ids]

    def heat(self, torque: Array, ids: EnvSelection) -> None:
        """A physics step with these torques, (k, 12), N·m, of those robots has passed."""
        thermal = self._thermal
        limit = thermal.ambient + self._rise * (torque * torque)
        temperature = limit + (self.temperature[ids] - limit) * self._kept
        off = self._off[ids] | (temperature >= thermal.shutdown)
        margin = np.clip((thermal.shutdown - temperature) / (thermal.shutdown - thermal.derating), 0.0, 1.0)
        share = np.where(off, 0.0, thermal.derated + (1 - thermal.derated) * margin)
        self.temperature[ids], self._off[ids] = temperature, off
        self._force_range[ids] = self.full_range[ids] * share[..., None]


class ActuatorDynamics:
    """The drives of n robots, a lag and windings or one of them, around the motors of a batch."""

    def __init__(
        self, lag: FirstOrderFilter | None, windings: MotorThermalModel | None, bind: Bind, substeps: int
    ) -> None:
        self._lag, self._windings, self._substeps = lag, windings, substeps
        self._ctrl, self._torque = bind("ctrl"), bind("actuator_force")
        self.full_range = None if windings is None else windings.full_range

    def reset(self, ids: EnvSelection) -> None:
        """Start those robots afresh."""
        if self._lag is not None:
            self._lag.reset(ids)
        if self._windings is not None:
            self._windings.reset(ids)

    def advance(self, targets: Array, ids: EnvSelection, advance: Advance) -> None:
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
) -> ActuatorDynamics | None:
    """The drives of those motors, or None where MuJoCo's own servos do all that is asked for."""
    curve, thermal, bandwidth = actuator.curve, actuator.thermal, min_limit(motors.bandwidth, actuator.bandwidth)
    if curve is None or (thermal is None and bandwidth is None):
        return None
    lag = None if bandwidth is None else FirstOrderFilter(bandwidth, timestep, len(bind("ctrl")), robot.home_pose)
    windings = (
        None
        if thermal is None
        else MotorThermalModel(thermal, curve.resolve(robot), timestep, expand("actuator_forcerange"))
    )
    return ActuatorDynamics(lag, windings, bind, substeps)
