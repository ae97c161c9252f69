"""Computation of observations from the true state with noise and latency, or from simulated sensors."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, Components, EnvIndices, ScalarOrBatch
from quad_env.physics.probe import IdealSensors
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import SensorNoise
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.estimator import AlignedReadings
from quad_env.sensing.estimators import make_estimator
from quad_env.sensing.sensor_models import Channel, Clock, Noise, SensorModels
from quad_env.sensing.suite import SensorSuite
from quad_env.task.observations import ObservationTable, observation_table


class ObservationDisturbance:
    """Adds the scenario's joint angle offsets, noise and latency, in this order, to observations.

    Args:
        robot: Robot that defines the layout of the observation.
        scenario: Scenario that defines the noise and the observation latency.
        num_envs: Number of robots.
        dt: Control period, s.
        has_encoder_offset: True to add the joint angle offsets that domain randomisation draws for each episode.
    """

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float, has_encoder_offset: bool) -> None:
        table = observation_table(robot)
        self._sensed = table.sensed
        self._bound = table.bound[table.sensed]
        self._joints = table.slices["joint_position"]
        self._offset = np.zeros((num_envs, robot.num_joints), np.float32) if has_encoder_offset else None
        self._table = table
        self._dt = dt
        self._noise = None if scenario.noise is None else Noise(num_envs, _noise_std(table, scenario.noise))
        delay_steps = 0 if scenario.latency is None else scenario.latency.observation_steps(dt)
        self._delay_steps = np.full(num_envs, delay_steps)
        """Delay of the observation of each robot, (n,), control steps."""
        self._delayed = Channel(num_envs, len(self._bound), None, delay_steps * dt, 1 / dt) if delay_steps else None

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Set the joint angle offsets, and restart the noise, of k robots that start a new episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            episodes: New episodes of the k robots.
        """
        for env_index, episode in zip(env_ids, episodes, strict=True):
            if self._noise is not None and episode.scenario.noise is not None:
                std = _noise_std(self._table, episode.scenario.noise)
                self._noise.reset(env_index, episode.streams.noise, std)
            if (latency := episode.scenario.latency) is not None:
                self._delay_steps[env_index] = latency.observation_steps(self._dt)
        if self._offset is not None:
            self._offset[env_ids] = [episode.randomised.encoder_offset for episode in episodes if episode.randomised]

    def disturb(self, observation: NDArray[np.float32], clock: Clock, env_ids: EnvIndices) -> None:
        """Add offsets, noise and latency to the observation terms that sensors measure, in place.

        Args:
            observation: Undisturbed observations of k robots, (k, width); previous action and command stay unchanged.
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).
        """
        sensed = observation[:, self._sensed]
        if self._offset is not None:
            sensed[:, self._joints] += self._offset[env_ids]
        if self._noise is not None:
            sensed += self._noise.at(clock, env_ids)
            np.clip(sensed, -self._bound, self._bound, out=sensed)
        if self._delayed is not None:
            self._delayed.record(sensed, clock, env_ids)
            sensed[:] = self._delayed.value(clock, env_ids, self._delay_steps[env_ids])


def _noise_std(table: ObservationTable, noise: SensorNoise) -> NDArray[np.float32]:
    """Return the standard deviation of each observation component that sensors measure, (width,)."""
    std = np.zeros(table.sensed.stop, np.float32)
    for term, term_std in noise.deviations.items():
        std[table.slices[term]] = term_std
    return std


class TrueStateObservation:
    """Observation model that uses the true state, with the scenario's offsets, noise and latency.

    Args:
        robot: Robot that defines the layout of the observation.
        disturbance: Joint angle offsets, noise and latency to add; None for the exact true state.

    Attributes:
        estimator: Always None, because the observed gravity and velocity come from the true state.
        is_exact: True if the observation is the undisturbed true state.
    """

    estimator = None

    def __init__(self, robot: Robot, disturbance: ObservationDisturbance | None = None) -> None:
        self._table = observation_table(robot)
        self._disturbance = disturbance
        self.is_exact = disturbance is None

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Restart offsets, noise and latency of k robots that start a new episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            episodes: New episodes of the k robots.
        """
        if self._disturbance is not None:
            self._disturbance.reset(env_ids, episodes)

    def observe(
        self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch], clock: Clock, env_ids: EnvIndices
    ) -> NDArray[np.float32]:
        """Compute the built-in observation terms of k robots.

        Args:
            state: Present state of the k robots.
            command: Velocity command to track next: forward, m/s, lateral, m/s, and yaw rate, rad/s.
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).

        Returns:
            Observation, (k, width), or (width,) if `state` holds floats of one robot.
        """
        observation = self._table.observe(state, command)
        if self._disturbance is not None:
            self._disturbance.disturb(np.atleast_2d(observation), clock, env_ids)
        return observation

    def readings(self) -> dict[str, NDArray[Any]]:
        """Return an empty dictionary of sensor readings, because the true state needs no sensors."""
        return {}


class SensorObservation:
    """Observation model that uses readings of simulated sensors, and an estimator of gravity and velocity.

    `angular_velocity` is the gyroscope reading minus the estimated bias. `joint_position` is the encoder reading minus
    the home pose. `joint_velocity` is the difference of the last two encoder samples divided by the sample period.
    `projected_gravity` and `linear_velocity` are estimated from readings that were all taken at the same time; the
    sensor with the longest delay determines the age of these readings. The scenario's noise and latency are added to
    the resulting observation.

    Args:
        robot: Geometry and home pose of the robots.
        suite: Sensors of the robots.
        ideal_sensors: Source of the noise-free sensor values in the simulation.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.
        estimator: Name of the estimator, one of `ESTIMATORS`.
        disturbance: Noise and latency that the scenario adds; None if the scenario has neither.

    Attributes:
        estimator: Estimator of gravity, velocity and gyroscope bias.
        is_exact: Always False, because the observation is not the true state.
    """

    is_exact = False

    def __init__(
        self,
        robot: Robot,
        suite: SensorSuite,
        ideal_sensors: IdealSensors,
        num_envs: int,
        control_rate: float,
        estimator: str,
        disturbance: ObservationDisturbance | None = None,
    ) -> None:
        self._ideal_sensors = ideal_sensors
        self._disturbance = disturbance
        self._home_pose = robot.home_pose
        self._table = observation_table(robot)
        self._bound = self._table.bound[self._table.sensed]
        self._sensors = SensorModels(robot, suite, num_envs, control_rate)
        self.estimator = make_estimator(estimator, robot, suite, self._sensors, num_envs, 1 / control_rate)
        self._last_update_step = np.full(num_envs, -1)
        """Control step of the episode in which the sensors of each of n robots were last read, (n,).

        The number is -1 if the sensors have not been read in the episode.
        """
        self._sensed_terms = np.zeros((num_envs, len(self._bound)), np.float32)
        """Numbers of the sensor-measured observation terms of n robots at the last reading, (n, width).

        The width is the number of components of all these terms.
        """

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Restart sensors, noise and latency of k robots that start a new episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            episodes: New episodes of the k robots.
        """
        self._last_update_step[env_ids] = -1
        self._sensors.reset(env_ids, episodes)
        if self._disturbance is not None:
            self._disturbance.reset(env_ids, episodes)

    def observe(
        self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch], clock: Clock, env_ids: EnvIndices
    ) -> NDArray[np.float32]:
        """Compute the built-in observation terms of k robots; read the sensors once per control step.

        Args:
            state: Present state of the k robots; only its previous action is observed.
            command: Velocity command to track next: forward, m/s, lateral, m/s, and yaw rate, rad/s.
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).

        Returns:
            Observation, (k, width), or (width,) if `state` holds floats of one robot.
        """
        is_new = self._last_update_step[env_ids] != clock
        if is_new.any():
            self._update(clock[is_new], env_ids[is_new])
        observation = self._table.assemble(self._sensed_terms[env_ids], state, command)
        if self._disturbance is not None:
            self._disturbance.disturb(np.atleast_2d(observation), clock, env_ids)
        return observation

    def readings(self) -> dict[str, NDArray[Any]]:
        """Return the newest sample of each sensor that can already be read, and the time of its measurement.

        A sample can be read after the delay of the sensor.

        Returns:
            Dictionary with two keys per sensor. `sensor_<name>` -> samples of n robots, (n, width), in the unit of the
            sensor. `sensor_<name>_time` -> time of each measurement since the start of the episode, (n,), s.
        """
        clock = np.maximum(self._last_update_step, 0)
        env_ids = np.arange(len(clock))
        out: dict[str, NDArray[Any]] = {}
        for name, channel in self._sensors.channels.items():
            out[f"sensor_{name}"] = channel.value(clock, env_ids)
            out[f"sensor_{name}_time"] = channel.time(clock)
        out["sensor_foot_contact"] = out["sensor_foot_contact"] > 0
        return out

    def _update(self, clock: Clock, env_ids: EnvIndices) -> None:
        """Read the sensors of the k robots `env_ids`, advance the estimator, and store the observation terms.

        `clock` is the number of control steps since the start of each robot's episode, (k,).
        """
        accelerometer_period = self._sensors.channels["accelerometer"].period
        true_values = self._ideal_sensors.read(env_ids, clock, accelerometer_period)
        self._sensors.read(true_values, clock, env_ids)
        self._update_estimates(true_values["up"], clock, env_ids)
        self._last_update_step[env_ids] = clock
        self._sensed_terms[env_ids] = self._compute_sensed_terms(clock, env_ids)

    def _update_estimates(self, up: Array, clock: Clock, env_ids: EnvIndices) -> None:
        """Reset the estimator of robots at the start of an episode; advance it by one step for other robots.

        In each episode, the estimator advances only after the delay of IMU, encoders and foot sensors, because their
        first readings arrive then. `up` is the unit vector of the world's vertical in IMU axes, (k, 3). `clock` is the
        number of control steps since the start of the episode, for each of the k robots `env_ids`, (k,).
        """
        readings = self._aligned_readings(clock, env_ids)
        is_first = clock == 0
        if is_first.any():
            specific_force = self._sensors.specific_force_at_rest(up[is_first], env_ids[is_first])
            self.estimator.reset(env_ids[is_first], specific_force, readings.select(is_first))
        has_advanced = clock > self._sensors.alignment_delay
        if has_advanced.any():
            self.estimator.update(readings.select(has_advanced), env_ids[has_advanced])

    def _aligned_readings(self, clock: Clock, env_ids: EnvIndices) -> AlignedReadings:
        """Return the newest readings of IMU, encoders and foot sensors that were all taken at the same time.

        `clock` is the number of control steps since the start of the episode, for each of the k robots `env_ids`, (k,).
        """
        delay_steps = self._sensors.alignment_delay
        channels = self._sensors.channels
        encoders = channels["joint_position"]
        feet = channels["foot_contact"]
        contact = feet.value(clock, env_ids, delay_steps) > 0
        return AlignedReadings(
            gyro=channels["gyro"].value(clock, env_ids, delay_steps),
            accelerometer=channels["accelerometer"].value(clock, env_ids, delay_steps),
            joints=encoders.value(clock, env_ids, delay_steps),
            previous_joints=encoders.previous(clock, env_ids, delay_steps),
            sustained_contact=contact & (feet.previous(clock, env_ids, delay_steps) > 0),
            contact=contact,
            has_new_angles=encoders.is_new(clock, delay_steps),
        )

    def _compute_sensed_terms(self, clock: Clock, env_ids: EnvIndices) -> Array:
        """Compute the observation terms of k robots that sensors measure, clipped to their bounds, (k, width).

        `clock` is the number of control steps since the start of the episode, for each of the k robots `env_ids`, (k,).
        """
        encoders = self._sensors.channels["joint_position"]
        joints = encoders.value(clock, env_ids)
        joint_change = joints - encoders.previous(clock, env_ids)
        gyro = self._sensors.channels["gyro"].value(clock, env_ids)
        terms = {
            "projected_gravity": self.estimator.gravity[env_ids],
            "angular_velocity": gyro - self.estimator.gyro_bias[env_ids],
            "linear_velocity": self.estimator.velocity[env_ids],
            "joint_position": joints - self._home_pose,
            "joint_velocity": joint_change / encoders.sample_period,
        }
        out = np.empty((len(env_ids), len(self._bound)))
        for name, values in terms.items():
            out[:, self._table.slices[name]] = values
        return np.clip(out, -self._bound, self._bound)


ObservationModel = TrueStateObservation | SensorObservation
"""Class that computes the observations of n robots, from the true state or from sensor readings."""


def make_observation_model(
    suite: SensorSuite | None,
    estimator: str,
    simulation: Simulation,
    scenario: Scenario,
    num_envs: int,
    control_rate: float,
) -> ObservationModel:
    """Create the observation model of n robots.

    Args:
        suite: Sensors of the robots; None to observe the true state.
        estimator: Name of the estimator, one of `ESTIMATORS`; not used if `suite` is None.
        simulation: Simulation of the robots.
        scenario: Scenario that defines noise, observation latency and domain randomisation.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.

    Returns:
        `TrueStateObservation` if `suite` is None, otherwise `SensorObservation`.
    """
    robot = simulation.robot
    dt = 1 / control_rate
    has_latency = scenario.latency is not None and scenario.latency.observation_steps(dt) > 0
    has_encoder_offset = suite is None and scenario.randomisation is not None
    disturbance = None
    if has_latency or has_encoder_offset or scenario.noise is not None:
        disturbance = ObservationDisturbance(robot, scenario, num_envs, dt, has_encoder_offset)
    if suite is None:
        return TrueStateObservation(robot, disturbance)
    assert simulation.probe is not None, "a simulation of robots without sensors"
    return SensorObservation(robot, suite, simulation.probe, num_envs, control_rate, estimator, disturbance)
