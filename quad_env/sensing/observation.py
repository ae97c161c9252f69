"""What n robots' observations show of their states: with noise, late, or as their own sensors have it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import EnvIndices
from quad_env.physics.probe import IdealSensors
from quad_env.physics.simulation import Simulation
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.channel import Channel, Clock, Noise
from quad_env.sensing.estimator import AlignedReadings
from quad_env.sensing.estimators import make_estimator
from quad_env.sensing.instruments import SensorModels
from quad_env.sensing.suite import SensorSuite
from quad_env.task.observations import observation_table


class ObservationDisturbance:
    """Noise and delay of n robots' sensors and, with `encoders`, offsets of joint angles; `clock` is each robot's
    control steps since its start."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float, encoders: bool) -> None:
        table = observation_table(robot)
        self._sensed, self._bound = table.sensed, table.bound[table.sensed]
        delay_steps = 0 if scenario.latency is None else round(scenario.latency.observation / dt)
        self._readings = Channel(num_envs, len(self._bound), None, delay_steps * dt, 1 / dt) if delay_steps else None
        self._joints = table.slices["joint_position"]
        self._offset = np.zeros((num_envs, robot.num_joints), np.float32) if encoders else None
        self._noise = None
        if scenario.noise is not None:
            deviations = np.zeros(table.sensed.stop, np.float32)
            for term, deviation in scenario.noise.deviations.items():
                deviations[table.slices[term]] = deviation
            self._noise = Noise(num_envs, deviations)

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots."""
        if self._noise is not None:
            for row, episode in zip(env_ids, episodes, strict=True):
                self._noise.reset(row, episode.streams.noise)
        if self._offset is not None:
            self._offset[env_ids] = [episode.randomised.encoder_offset for episode in episodes if episode.randomised]

    def sense(self, observation: NDArray[np.float32], clock: NDArray[np.int64], env_ids: EnvIndices) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        sensed = observation[:, self._sensed]
        if self._offset is not None:
            sensed[:, self._joints] += self._offset[env_ids]
        if self._noise is not None:
            sensed += self._noise.at(clock, env_ids)
            np.clip(sensed, -self._bound, self._bound, out=sensed)
        if self._readings is not None:
            self._readings.record(sensed, clock, env_ids)
            sensed[:] = self._readings.value(clock, env_ids)


class SensorObservation:
    """Puts what sensors read in place of what is true.

    `angular_velocity` is the gyroscope's, less the bias that the estimator makes out, `joint_position` the encoders',
    `joint_velocity` the difference of their last two samples by the time between; `projected_gravity` and
    `linear_velocity` are estimated from readings of the same moment, that of the slowest of the sensors that take part.
    A scenario's noise and latency come on top: `disturbed`.
    """

    def __init__(
        self,
        robot: Robot,
        suite: SensorSuite,
        probe: IdealSensors,
        num_envs: int,
        control_rate: float,
        estimator: str,
        disturbance: ObservationDisturbance | None = None,
    ) -> None:
        self._probe, self._disturbed = probe, disturbance
        self._home, self._table = robot.home_pose, observation_table(robot)
        self._bound = self._table.bound[self._table.sensed]
        self._instruments = SensorModels(robot, suite, num_envs, control_rate)
        self.estimator = make_estimator(estimator, robot, suite, self._instruments, num_envs, 1 / control_rate)
        """Where gravity and velocity are from."""
        self._last_update_step = np.full(num_envs, -1)
        """Control step of each robot's last look, since its start."""
        self._shown = np.zeros((num_envs, len(self._bound)), np.float32)
        self._rows = np.arange(num_envs)

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots."""
        self._last_update_step[env_ids] = -1
        self._instruments.reset(env_ids, episodes)
        if self._disturbed is not None:
            self._disturbed.reset(env_ids, episodes)

    def sense(self, observation: NDArray[np.float32], clock: Clock, env_ids: EnvIndices) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        new = self._last_update_step[env_ids] != clock
        if new.any():
            self._update(clock[new], env_ids[new])
        observation[:, self._table.sensed] = self._shown[env_ids]
        if self._disturbed is not None:
            self._disturbed.sense(observation, clock, env_ids)

    def readings(self) -> dict[str, NDArray[Any]]:
        """`sensor_<name>` -> value, (n, k); `sensor_<name>_time` -> when it was measured, (n,), s from the start."""
        clock, out = np.maximum(self._last_update_step, 0), dict[str, NDArray[Any]]()
        for name, channel in self._instruments.channels.items():
            out[f"sensor_{name}"] = channel.value(clock, self._rows)
            out[f"sensor_{name}_time"] = channel.time(clock)
        out["sensor_foot_contact"] = out["sensor_foot_contact"] > 0
        return out

    def _update(self, clock: Clock, env_ids: EnvIndices) -> None:
        measured = self._probe.measured(env_ids, clock, self._instruments.channels["accelerometer"].period)
        self._instruments.read(measured, clock, env_ids)
        self._estimate(measured["up"], clock, env_ids)
        self._last_update_step[env_ids] = clock
        channels = self._instruments.channels
        encoders = channels["joint_position"]
        joints = encoders.value(clock, env_ids)
        in_order = {
            "projected_gravity": self.estimator.gravity[env_ids],
            "angular_velocity": channels["gyro"].value(clock, env_ids) - self.estimator.gyro_bias[env_ids],
            "linear_velocity": self.estimator.velocity[env_ids],
            "joint_position": joints - self._home,
            "joint_velocity": (joints - encoders.previous(clock, env_ids)) / encoders.sample_period,
        }
        shown = np.empty((len(env_ids), len(self._bound)))
        for name, values in in_order.items():
            shown[:, self._table.slices[name]] = values
        self._shown[env_ids] = np.clip(shown, -self._bound, self._bound)

    def _estimate(self, up: NDArray[np.float64], clock: Clock, env_ids: EnvIndices) -> None:
        """Move the estimates on, from the start at clock 0, when no time has passed."""
        read = self._read(clock, env_ids)
        if (first := clock == 0).any():
            at_rest = self._instruments.at_rest(up[first], env_ids[first])
            self.estimator.reset(env_ids[first], at_rest, read.of(first))
        if (moved := clock > self._instruments.alignment_delay).any():
            self.estimator.update(read.of(moved), env_ids[moved])

    def _read(self, clock: Clock, env_ids: EnvIndices) -> AlignedReadings:
        delay_steps, channels = self._instruments.alignment_delay, self._instruments.channels
        encoders, feet = channels["joint_position"], channels["foot_contact"]
        contact = feet.value(clock, env_ids, delay_steps) > 0
        return AlignedReadings(
            channels["gyro"].value(clock, env_ids, delay_steps),
            channels["accelerometer"].value(clock, env_ids, delay_steps),
            encoders.value(clock, env_ids, delay_steps),
            encoders.previous(clock, env_ids, delay_steps),
            contact & (feet.previous(clock, env_ids, delay_steps) > 0),
            contact,
            encoders.is_new(clock, delay_steps),
        )


def make_observation_model(
    suite: SensorSuite | None,
    estimator: str,
    simulation: Simulation,
    scenario: Scenario,
    num_envs: int,
    control_rate: float,
) -> SensorObservation | ObservationDisturbance | None:
    """What stands between the robots' states and their observations; None where they show every reading as it is."""
    robot, dt = simulation.robot, 1 / control_rate
    delay_steps = scenario.latency is not None and round(scenario.latency.observation / dt) > 0
    offset = suite is None and scenario.randomisation is not None
    needed = delay_steps or offset or scenario.noise is not None
    disturbance = ObservationDisturbance(robot, scenario, num_envs, dt, offset) if needed else None
    if suite is None:
        return disturbance
    assert simulation.probe is not None, "a simulation of robots without sensors"
    return SensorObservation(robot, suite, simulation.probe, num_envs, control_rate, estimator, disturbance)
