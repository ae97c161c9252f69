"""Models of the joint actuators of n robots: delay, dropouts, low-pass filter and motor temperature."""

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


class ActionDelay:
    """Delay of the joint targets of n robots by whole control steps, with dropouts of single joints.

    A dropout is a time interval in which one joint receives no new targets and holds its last target.

    Args:
        robot: Robot, which defines the number of joints and the home pose.
        scenario: Scenario, which defines the action latency, the range of the randomised delay, and the dropouts.
        num_envs: Number of robots.
        dt: Control period, s.
    """

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        dropouts = scenario.dropouts
        dropout_count = 0 if dropouts is None else dropouts.count
        self._home = robot.home_pose
        self._delay_steps = np.zeros(num_envs, np.int64)
        self._target_buffer = np.zeros((_max_delay_steps(scenario, dt) + 1, num_envs, robot.num_joints))
        """Ring buffer of past joint targets of n robots, (length, n, 12), rad.

        The targets of control step c are at the index c modulo length.
        """
        self._delayed_targets = np.zeros((num_envs, robot.num_joints))
        self._dropout_start = np.zeros((num_envs, dropout_count), np.int64)
        """First control step of each dropout in the present episode of each of n robots, (n, dropouts)."""
        self._dropout_steps = np.zeros(num_envs, np.int64)
        """Duration of each robot's dropouts, in which a joint receives no new targets, (n,), control steps."""
        self._dt = dt
        self._dropout_joint = np.zeros((num_envs, dropout_count), np.int64)

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start new episodes; the servos hold the home pose until the first targets arrive.

        Args:
            env_ids: Indices of the robots, (k,).
            episodes: New episodes of the k robots, which define delays and dropouts.
        """
        self._target_buffer[:, env_ids] = self._home
        self._delayed_targets[env_ids] = self._home
        for row, episode in zip(env_ids, episodes, strict=True):
            self._delay_steps[row] = episode.action_delay
            if episode.dropouts is not None:
                self._dropout_start[row], self._dropout_joint[row] = episode.dropouts
            if (dropouts := episode.scenario.dropouts) is not None:
                self._dropout_steps[row] = control_steps(dropouts.duration, self._dt)

    def update(self, targets: Array, clock: NDArray[np.int64], env_ids: EnvIndices) -> Array:
        """Store the targets of this control step, and return the delayed targets that the servos receive.

        Args:
            targets: Joint targets of the policies for all n robots, (n, 12), rad.
            clock: Number of control steps since the start of the episode, for each of k selected robots, (k,).
            env_ids: Indices of the k selected robots, (k,); the other robots keep their delayed targets.

        Returns:
            Delayed targets of all n robots, (n, 12), rad.
        """
        slots = len(self._target_buffer)
        self._target_buffer[clock % slots, env_ids] = targets[env_ids]
        arriving = self._target_buffer[(clock - self._delay_steps[env_ids]) % slots, env_ids]
        if self._dropout_start.size:
            is_dropped = self._dropout_mask(clock, env_ids)
            arriving = np.where(is_dropped, self._delayed_targets[env_ids], arriving)
        self._delayed_targets[env_ids] = arriving
        return self._delayed_targets

    def _dropout_mask(self, clock: NDArray[np.int64], env_ids: EnvIndices) -> Mask:
        """Return True for each joint of k robots that receives no new target in this control step, (k, 12).

        `clock` is the number of control steps since the start of the episode, for each robot in `env_ids`, (k,).
        """
        elapsed = clock[:, None] - self._dropout_start[env_ids]
        mask = np.zeros((len(env_ids), self._delayed_targets.shape[1]), np.bool_)
        robot, event = np.nonzero((elapsed >= 0) & (elapsed < self._dropout_steps[env_ids, None]))
        mask[robot, self._dropout_joint[env_ids[robot], event]] = True
        return mask


def make_action_delay(robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> ActionDelay | None:
    """Create the action delay of n robots.

    Args:
        robot: Robot, which defines the number of joints and the home pose.
        scenario: Scenario, which defines the action latency, the range of the randomised delay, and the dropouts.
        num_envs: Number of robots.
        dt: Control period, s.

    Returns:
        The action delay; None if the scenario has neither action delays nor dropouts.
    """
    has_dropouts = scenario.dropouts is not None and scenario.dropouts.count > 0
    if not has_dropouts and not _max_delay_steps(scenario, dt):
        return None
    return ActionDelay(robot, scenario, num_envs, dt)


def _max_delay_steps(scenario: Scenario, dt: float) -> int:
    """Return the longest possible delay of joint targets in `scenario`, in control steps of `dt` seconds."""
    latency = 0.0 if scenario.latency is None else scenario.latency.action
    randomised = 0.0 if scenario.randomisation is None else scenario.randomisation.delay
    return round(latency / dt) + round(randomised / dt)


class FirstOrderFilter:
    """First-order low-pass filter of the joint targets of n robots.

    The filter output is exact if the targets are constant over a physics step, as with MuJoCo's `filterexact`. In each
    physics step, a motor receives the filter output at the start of the step.

    Args:
        bandwidth: Corner frequency of the filter, Hz.
        timestep: Physics step, s.
        num_envs: Number of robots.
        home: Home pose, the initial output of the filter, (12,), rad.
    """

    def __init__(self, bandwidth: float, timestep: float, num_envs: int, home: Array) -> None:
        self._home = home
        self._gain = 1 - math.exp(-timestep * 2 * math.pi * bandwidth)
        self._value = np.tile(home, (num_envs, 1))

    def reset(self, env_ids: EnvSelection) -> None:
        """Set the filter output of the robots with the indices `env_ids` to the home pose."""
        self._value[env_ids] = self._home

    def update(self, targets: Array, env_ids: EnvSelection, count: int) -> Array:
        """Advance the filters of k robots by `count` physics steps with constant targets.

        Args:
            targets: Joint targets of the k robots during the physics steps, (k, 12), rad.
            env_ids: Indices of the k robots, or a slice.
            count: Number m of physics steps.

        Returns:
            Filtered joint targets at the start of each physics step, (m, k, 12), rad.
        """
        outputs = np.empty((count, *targets.shape))
        value = self._value[env_ids]
        for number in range(count):
            outputs[number] = value
            value = value + self._gain * (targets - value)
        self._value[env_ids] = value
        return outputs


class MotorThermalModel:
    """First-order thermal model of the motors of n robots, which lowers the torque limit of a hot motor.

    `Thermal` documents the equations. The thermal model of MuJoCo 4.0's `dcmotor` is not used, because it computes the
    heat from the current before the force range limits the torque. A motor that is switched off would then be heated
    by a current that it does not carry.

    Args:
        thermal: Thermal parameters of the motor windings.
        curve: Torque-speed curves of the motors, which determine the heat loss at a torque.
        timestep: Physics step, s.
        force_range: MuJoCo's lower and upper torque limits of each motor, (n, 12, 2), N·m; `update` writes to it.
    """

    def __init__(self, thermal: Thermal, curve: ResolvedTorqueSpeed, timestep: float, force_range: Array) -> None:
        self._thermal = thermal
        self._temperature_per_torque2 = thermal.resistance / curve.slope
        """Steady-state temperature rise of each motor's winding, divided by its squared torque, (12,), K/(N·m)²."""
        self._decay = math.exp(-timestep / thermal.time_constant)
        """Factor on the difference between winding temperature and steady-state temperature per physics step."""
        self._force_range = force_range
        self.full_range = force_range.copy()
        """Lower and upper torque limits of each motor of n robots when the motor is cold, (n, 12, 2), N·m.

        Changes of this array take effect at the next reset.
        """
        self.temperature = np.full(force_range.shape[:2], thermal.ambient)
        """Winding temperature of each motor of n robots, (n, 12), °C."""
        self._is_off: Mask = np.zeros(force_range.shape[:2], np.bool_)
        self._has_full_range: Mask = np.ones(len(force_range), np.bool_)
        """True for robots with motors that all have the limits in `full_range`, (n,)."""
        self._cool_fraction = thermal.derated + (1 - thermal.derated) * 1.0
        """Fraction of the full limit of a cool motor as `update` computes it, which rounding may change from 1."""

    def has_cool_motors(self, env_ids: EnvSelection) -> bool:
        """Return True if all motors of the robots `env_ids` have full torque limits and are too cool to lose them."""
        hottest = self.temperature[env_ids].max(initial=self._thermal.ambient)
        is_cool = self._cool_fraction == 1.0 and hottest <= self._thermal.derating
        return bool(is_cool and self._has_full_range[env_ids].all())

    def reset(self, env_ids: EnvSelection) -> None:
        """Set the motors of the robots `env_ids` to the ambient temperature and to the limits in `full_range`."""
        self.temperature[env_ids] = self._thermal.ambient
        self._is_off[env_ids] = False
        self._has_full_range[env_ids] = True
        self._force_range[env_ids] = self.full_range[env_ids]

    def update(self, torque: Array, env_ids: EnvSelection) -> None:
        """Advance winding temperatures and torque limits of k robots by a physics step.

        Args:
            torque: Motor torques of the k robots in the physics step, (k, 12), N·m.
            env_ids: Indices of the k robots, or a slice.
        """
        self.temperature[env_ids] = self._next_temperature(self._steady_temperature(torque), self.temperature[env_ids])
        if not self.has_cool_motors(env_ids):
            self._derate(self.temperature[env_ids], env_ids)

    def update_cool_motors(self, torques: Array, env_ids: EnvSelection) -> bool:
        """Advance winding temperatures of k robots with cool motors by several physics steps.

        Nothing changes if a motor becomes so hot in these steps that it loses torque, because its torques in later
        steps are then wrong.

        Args:
            torques: Motor torques of the k robots in each of m physics steps, (m, k, 12), N·m.
            env_ids: Indices of the k robots, or a slice.

        Returns:
            True if the temperatures have advanced.
        """
        temperatures = [self.temperature[env_ids]]
        for steady in self._steady_temperature(torques):
            temperatures.append(self._next_temperature(steady, temperatures[-1]))
        if not np.max(temperatures, initial=self._thermal.ambient) <= self._thermal.derating:
            return False
        self.temperature[env_ids] = temperatures[-1]
        return True

    def _steady_temperature(self, torque: Array) -> Array:
        """Return the winding temperatures to which constant torques lead, (..., 12), °C; `torque` is in N·m."""
        return self._thermal.ambient + self._temperature_per_torque2 * (torque * torque)

    def _next_temperature(self, steady: Array, temperature: Array) -> Array:
        """Return the winding temperatures, (k, 12), °C, a physics step after `temperature`, on the way to `steady`."""
        return steady + (temperature - steady) * self._decay

    def _derate(self, temperature: Array, env_ids: EnvSelection) -> None:
        """Set the torque limits of the robots `env_ids` to those at the winding temperatures `temperature`, (k, 12)."""
        thermal = self._thermal
        is_off = self._is_off[env_ids] | (temperature >= thermal.shutdown)
        margin = np.clip((thermal.shutdown - temperature) / (thermal.shutdown - thermal.derating), 0.0, 1.0)
        limit_fraction = np.where(is_off, 0.0, thermal.derated + (1 - thermal.derated) * margin)
        self._is_off[env_ids] = is_off
        self._has_full_range[env_ids] = (limit_fraction == 1.0).all(axis=1)
        self._force_range[env_ids] = self.full_range[env_ids] * limit_fraction[..., None]


def make_target_filter(
    robot: Robot, motors: Motors, actuator: Actuator, num_envs: int, timestep: float
) -> FirstOrderFilter | None:
    """Create the low-pass filter of the joint targets for motors with a torque-speed curve.

    Args:
        robot: Robot, which defines the home pose.
        motors: Motor limits of the scenario.
        actuator: Model of the joint servos.
        num_envs: Number of robots.
        timestep: Physics step, s.

    Returns:
        The filter; None if neither the scenario nor the actuator limits the bandwidth. The result is also None if the
        actuator has no torque-speed curve, because MuJoCo's own servos then filter the targets.
    """
    bandwidth = min_limit(motors.bandwidth, actuator.bandwidth)
    if actuator.curve is None or bandwidth is None:
        return None
    return FirstOrderFilter(bandwidth, timestep, num_envs, robot.home_pose)


def make_thermal_model(
    robot: Robot, actuator: Actuator, timestep: float, expand: Callable[[str], Array]
) -> MotorThermalModel | None:
    """Create the thermal model of the motors of n robots.

    Args:
        robot: Robot with the motors.
        actuator: Model of the joint servos.
        timestep: Physics step, s.
        expand: Function that takes the name of a field of `mujoco.MjModel`. The function gives every robot its own
            values of this field, and returns these values as an array with one row per robot, (n, ...).

    Returns:
        The thermal model; None if the actuator has no thermal model.
    """
    if actuator.curve is None or actuator.thermal is None:
        return None
    curve = actuator.curve.resolve(robot)
    return MotorThermalModel(actuator.thermal, curve, timestep, expand("actuator_forcerange"))
