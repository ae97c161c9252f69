"""What n robots' observations show of their states: with noise, late, or as their own sensors have it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Rows
from quad_env.physics.probe import Probe
from quad_env.physics.simulation import Simulation
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.channel import Channel, Clock, Noise
from quad_env.sensing.estimator import Read
from quad_env.sensing.estimators import make_estimator
from quad_env.sensing.instruments import Instruments
from quad_env.sensing.suite import SensorSuite
from quad_env.task.observations import observation_table


class Sensors:
    """Noise and delay of n robots' sensors and, with `encoders`, offsets of joint angles; `clock` is each robot's
    control steps since its start."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float, encoders: bool) -> None:
        table = observation_table(robot)
        self._sensed, self._bound = table.sensed, table.bound[table.sensed]
        late = 0 if scenario.latency is None else round(scenario.latency.observation / dt)
        self._readings = Channel(num_envs, len(self._bound), None, late * dt, 1 / dt) if late else None
        self._joints = table.slices["joint_position"]
        self._offset = np.zeros((num_envs, robot.num_joints), np.float32) if encoders else None
        self._noise = None
        if scenario.noise is not None:
            deviations = np.zeros(table.sensed.stop, np.float32)
            for term, deviation in scenario.noise.deviations.items():
                deviations[table.slices[term]] = deviation
            self._noise = Noise(num_envs, deviations)

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Start these episodes of those robots."""
        if self._noise is not None:
            for row, episode in zip(rows, episodes, strict=True):
                self._noise.begin(row, episode.streams.noise)
        if self._offset is not None:
            self._offset[rows] = [episode.randomised.encoder_offset for episode in episodes if episode.randomised]

    def sense(self, observation: NDArray[np.float32], clock: NDArray[np.int64], rows: Rows) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        sensed = observation[:, self._sensed]
        if self._offset is not None:
            sensed[:, self._joints] += self._offset[rows]
        if self._noise is not None:
            sensed += self._noise.at(clock, rows)
            np.clip(sensed, -self._bound, self._bound, out=sensed)
        if self._readings is not None:
            self._readings.take(sensed, clock, rows)
            sensed[:] = self._readings.value(clock, rows)


class SensedObservation:
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
        probe: Probe,
        num_envs: int,
        control_rate: float,
        estimator: str,
        disturbed: Sensors | None = None,
    ) -> None:
        self._probe, self._disturbed = probe, disturbed
        self._home, self._table = robot.home_pose, observation_table(robot)
        self._bound = self._table.bound[self._table.sensed]
        self._instruments = Instruments(robot, suite, num_envs, control_rate)
        self.estimator = make_estimator(estimator, robot, suite, self._instruments, num_envs, 1 / control_rate)
        """Where gravity and velocity are from."""
        self._looked = np.full(num_envs, -1)
        """Control step of each robot's last look, since its start."""
        self._shown = np.zeros((num_envs, len(self._bound)), np.float32)
        self._rows = np.arange(num_envs)

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Start these episodes of those robots."""
        self._looked[rows] = -1
        self._instruments.begin(rows, episodes)
        if self._disturbed is not None:
            self._disturbed.begin(rows, episodes)

    def sense(self, observation: NDArray[np.float32], clock: Clock, rows: Rows) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        new = self._looked[rows] != clock
        if new.any():
            self._look(clock[new], rows[new])
        observation[:, self._table.sensed] = self._shown[rows]
        if self._disturbed is not None:
            self._disturbed.sense(observation, clock, rows)

    def readings(self) -> dict[str, NDArray[Any]]:
        """`sensor_<name>` -> value, (n, k); `sensor_<name>_time` -> when it was measured, (n,), s from the start."""
        clock, out = np.maximum(self._looked, 0), dict[str, NDArray[Any]]()
        for name, channel in self._instruments.channels.items():
            out[f"sensor_{name}"] = channel.value(clock, self._rows)
            out[f"sensor_{name}_time"] = channel.time(clock)
        out["sensor_foot_contact"] = out["sensor_foot_contact"] > 0
        return out

    def _look(self, clock: Clock, rows: Rows) -> None:
        measured = self._probe.measured(rows, clock, self._instruments.channels["accelerometer"].period)
        self._instruments.read(measured, clock, rows)
        self._estimate(measured["up"], clock, rows)
        self._looked[rows] = clock
        channels = self._instruments.channels
        encoders = channels["joint_position"]
        joints = encoders.value(clock, rows)
        in_order = {
            "projected_gravity": self.estimator.gravity[rows],
            "angular_velocity": channels["gyro"].value(clock, rows) - self.estimator.gyro_bias[rows],
            "linear_velocity": self.estimator.velocity[rows],
            "joint_position": joints - self._home,
            "joint_velocity": (joints - encoders.before(clock, rows)) / encoders.spacing,
        }
        shown = np.empty((len(rows), len(self._bound)))
        for name, values in in_order.items():
            shown[:, self._table.slices[name]] = values
        self._shown[rows] = np.clip(shown, -self._bound, self._bound)

    def _estimate(self, up: NDArray[np.float64], clock: Clock, rows: Rows) -> None:
        """Move the estimates on, from the start at clock 0, when no time has passed."""
        read = self._read(clock, rows)
        if (first := clock == 0).any():
            at_rest = self._instruments.at_rest(up[first], rows[first])
            self.estimator.begin(rows[first], at_rest, read.of(first))
        if (moved := clock > self._instruments.aligned).any():
            self.estimator.move_on(read.of(moved), rows[moved])

    def _read(self, clock: Clock, rows: Rows) -> Read:
        late, channels = self._instruments.aligned, self._instruments.channels
        encoders, feet = channels["joint_position"], channels["foot_contact"]
        contact = feet.value(clock, rows, late) > 0
        return Read(
            channels["gyro"].value(clock, rows, late),
            channels["accelerometer"].value(clock, rows, late),
            encoders.value(clock, rows, late),
            encoders.before(clock, rows, late),
            contact & (feet.before(clock, rows, late) > 0),
            contact,
            encoders.fresh(clock, late),
        )


def shown_by(
    suite: SensorSuite | None,
    estimator: str,
    simulation: Simulation,
    scenario: Scenario,
    num_envs: int,
    control_rate: float,
) -> SensedObservation | Sensors | None:
    """What stands between the robots' states and their observations; None where they show every reading as it is."""
    robot, dt = simulation.robot, 1 / control_rate
    late = scenario.latency is not None and round(scenario.latency.observation / dt) > 0
    offset = suite is None and scenario.randomisation is not None
    needed = late or offset or scenario.noise is not None
    disturbed = Sensors(robot, scenario, num_envs, dt, offset) if needed else None
    if suite is None:
        return disturbed
    assert simulation.probe is not None, "a simulation of robots without sensors"
    return SensedObservation(robot, suite, simulation.probe, num_envs, control_rate, estimator, disturbed)
