"""Simulated robot with low-level motor commands: stiffness, damping and torque come with each command."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.unitree.motors import MotorCommands, damped
from policies.base import Floats
from quad_env.actuation.hardware import HardwareProfile, hardware_profile
from quad_env.actuation.models import Actuator
from quad_env.actuation.runtime import ActionDelay, make_action_delay
from quad_env.cli.command_line import UsageError
from quad_env.physics.energy import sum_foot_forces, touch_sensors
from quad_env.physics.model import servo_fields, torque_limits
from quad_env.physics.rotations import quaternion, roll_pitch_yaw
from quad_env.physics.simulation import ALL, Simulation, SimulationConfig
from quad_env.physics.state import heading_velocity, rotation_matrix
from quad_env.robots.robot import JOINTS, Robot
from quad_env.scenarios.episode import EpisodeSample, stack_initial_conditions
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.schedule import EpisodeSchedule
from quad_env.sensing.estimators import COMPLEMENTARY
from quad_env.sensing.observation import make_observation_model
from quad_env.sensing.suite import SensorSuite, sensor_suite
from quad_env.task.observations import observation_table

RATE = 500.0
"""Control steps per second, Hz: the rate of Unitree's low-level messages."""
SENSOR_RATE = 100.0
"""Sample rate of the sensors of the hardware profile, Hz: the control rate of the environment."""
_ROWS = np.zeros(1, np.intp)
_AT_CENTRE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""Position and rotation of an ideal IMU."""


class LowLevelReading(NamedTuple):
    """Readings of a robot after a step; joints and legs are in the order of the robot."""

    time: float
    """Simulated time since the start, s."""
    quaternion: Floats
    """Quaternion (w, x, y, z) from the base frame to the world frame, (4,)."""
    gyroscope: Floats
    """Angular velocity, base frame, (3,), rad/s."""
    accelerometer: Floats
    """Specific force (acceleration minus gravity), base frame, (3,), m/s²."""
    joint_position: Floats
    """Joint angles, (12,), rad."""
    joint_velocity: Floats
    """Joint velocities, (12,), rad/s."""
    joint_torque: Floats
    """Torques of the motors in the last physics step, (12,), N·m."""
    foot_force: Floats
    """Ground force on each foot, (4,), N."""
    position: Floats
    """Position of the trunk centre, world frame, (3,), m."""
    velocity: Floats
    """Velocity of the trunk centre, world frame, (3,), m/s."""
    yaw_rate: float
    """Yaw rate about the vertical, rad/s."""
    height: float
    """Height of the trunk centre above the terrain below it, m."""


class LowLevelRobot:
    """Simulated robot in a scenario, with commands of stiffness, damping and torque for each joint.

    The scenario defines ground, load, pushes, motors, delays and noise, as in the environment. Its pushes and dropouts
    begin with the first step with `is_active`. Noise and latency act on gyroscope, orientation, and joint
    angles and velocities.

    Args:
        robot: Robot to simulate.
        scenario: Scenario of the episode.
        seed: Seed of the episode.

    Attributes:
        simulation: Simulation with the one robot.
        has_diverged: True if the last step put a diverged robot back into its home pose.

    Raises:
        UsageError: The motors of the scenario have a thermal model, or 500 Hz does not fit the physics step.
    """

    def __init__(self, robot: Robot, scenario: Scenario, seed: int) -> None:
        self.robot = robot
        self.has_diverged = False
        profile = hardware_profile(robot) if scenario.hardware else None
        if profile is not None and profile.actuator.thermal is not None:
            fact = f"motors with a thermal model need servo targets, got {robot.name} on {scenario.name}"
            raise UsageError(f"--scenario: {fact}; valid: scenarios without +hardware, or another robot")
        self._suite = None if profile is None else _at_environment_rate(profile.sensors)
        self.simulation = _make_simulation(robot, scenario, profile, self._suite)
        self._schedule = EpisodeSchedule(robot, scenario, 1, 1 / RATE)
        self._delay = make_action_delay(robot, scenario, len(MotorCommands._fields), 1 / RATE)
        self._motor_delay_steps = 0 if profile is None else round(profile.actuator.delay * RATE)
        curve = None if profile is None else profile.actuator.curve
        self._curve = None if curve is None else curve.resolve(robot)
        self._nominal_torque = torque_limits(robot, scenario.motors, self._curve)
        self._observation = make_observation_model(self._suite, COMPLEMENTARY, self.simulation, scenario, 1, RATE)
        self._bind_motors()
        self.reset(seed)

    def _bind_motors(self) -> None:
        """Get the model fields of gains, bias torque and torque limits, and the outputs of the foot sensors."""
        simulation = self.simulation
        batch = simulation.batch
        (self._gain, self._angle_bias), (self._speed_bias,) = servo_fields(simulation.model, batch.expand)
        self._bias_torque = batch.expand("actuator_biasprm")[:, :, 0]
        self._torque_limits = batch.expand("actuator_forcerange")
        self._touch = [
            [batch.sensor(name).data for name in names] for names in touch_sensors(self.robot, simulation.model)
        ]

    def reset(self, seed: int) -> None:
        """Start the first episode of `seed`: the robot stands in its start pose with damped motors."""
        self._schedule.reseed(seed, np.ones(1, np.bool_))
        episodes = self._schedule.reset(_ROWS, None)
        self.simulation.reset(_ROWS, *stack_initial_conditions(episodes))
        self._observation.reset(_ROWS, episodes)
        self._step_count = np.zeros(1, np.int64)
        sample = episodes[0].randomised
        self._gain_factors = (
            (np.ones(JOINTS), np.ones(JOINTS)) if sample is None else (sample.stiffness, sample.damping)
        )
        self._max_torque = self._nominal_torque * (1.0 if sample is None else sample.motor_strength)
        self._torque_limits[0] = np.stack((-self._max_torque, self._max_torque), axis=-1)
        self._rest = np.stack(damped())
        self._history = [self._rest] * (self._motor_delay_steps + 1)
        if self._delay is not None:
            _reset_delay(self._delay, episodes[0])

    def step(self, commands: MotorCommands, is_active: bool = True) -> LowLevelReading:
        """Advance the robot by one control step, and read its sensors.

        Args:
            commands: Commands of the joints, in the order of the robot.
            is_active: False before the episode: then its pushes and dropouts do not advance.

        Returns:
            Readings after the step.
        """
        self._apply(MotorCommands(*self._delayed(np.stack(commands))))
        schedule = self._schedule
        push = schedule.push_force() if is_active else None
        self.simulation.step(self._targets, push, ALL)
        self._step_count += 1
        if is_active:
            schedule.count_step(None)
        _, diverged = self.simulation.read_coordinates(None)
        self.has_diverged = bool(diverged)
        if diverged:
            self.simulation.reset_diverged(_ROWS)
        return self.read()

    def _delayed(self, commands: Floats) -> Floats:
        """Return the commands that reach the motors now, (5, 12), after the delays of scenario and hardware."""
        if self._delay is not None:
            # The delay starts with the home pose in each row, and the commands start with damped motors.
            offset = self._rest - self.robot.home_pose
            rows = np.arange(len(commands))
            clock = np.repeat(self._schedule.step_count, len(commands))
            commands = self._delay.update(commands - offset, clock, rows) + offset
        self._history = [*self._history[1:], commands]
        return self._history[0]

    def _apply(self, commands: MotorCommands) -> None:
        """Write the commands into the model of the motors; target angles are clipped to the joint limits."""
        stiffness_factor, damping_factor = self._gain_factors
        stiffness = commands.kp * stiffness_factor
        damping = commands.kd * damping_factor
        self._gain[0] = stiffness
        self._angle_bias[0] = -stiffness
        self._speed_bias[0] = -damping
        self._bias_torque[0] = commands.tau + damping * commands.dq
        self._targets = np.clip(commands.q, self.robot.joint_lower, self.robot.joint_upper)[None]
        if self._curve is not None:
            lower, upper = self._curve.limits(self.simulation.qvel[0, 6:])
            self._torque_limits[0, :, 0] = np.maximum(lower, -self._max_torque)
            self._torque_limits[0, :, 1] = np.minimum(upper, self._max_torque)

    def read(self) -> LowLevelReading:
        """Return the readings at the present state."""
        simulation = self.simulation
        qpos = simulation.qpos[0].copy()
        qvel = simulation.qvel[0].copy()
        torque = np.array(simulation.torque[0])
        terms, accelerometer = self._sense(qpos, qvel)
        rotation = rotation_matrix(tuple(qpos[3:7]))
        return LowLevelReading(
            time=float(self._step_count[0] / RATE),
            quaternion=terms["quaternion"],
            gyroscope=terms["angular_velocity"],
            accelerometer=accelerometer,
            joint_position=terms["joint_position"],
            joint_velocity=terms["joint_velocity"],
            joint_torque=torque,
            foot_force=np.asarray(sum_foot_forces(self._touch, ALL)[0]),
            position=qpos[:3],
            velocity=qvel[:3],
            yaw_rate=float(heading_velocity(rotation, tuple(qvel[:3]), tuple(qvel[3:6]))[2]),
            height=float(qpos[2] - simulation.terrain.height(qpos[0], qpos[1])),
        )

    def _sense(self, qpos: Floats, qvel: Floats) -> tuple[dict[str, Floats], Floats]:
        """Return orientation, angular velocity and joints as sensors read them, and the accelerometer.

        Args:
            qpos: Generalised positions, (19,).
            qvel: Generalised velocities, (18,).

        Returns:
            terms: Name of a reading -> its numbers.
            accelerometer: Specific force, base frame, (3,), m/s².
        """
        observation = self._observation
        probe = self.simulation.probe
        assert probe is not None, "a simulation without IMU"
        if observation.is_exact:
            true_values = probe.read(_ROWS, self._step_count, 1)
            terms = {
                "quaternion": qpos[3:7],
                "angular_velocity": qvel[3:6],
                "joint_position": qpos[7:],
                "joint_velocity": qvel[6:],
            }
            return terms, true_values["accelerometer"][0]
        state = self.simulation.state((0.0, 0.0, 0.0), None)
        observed = np.atleast_2d(observation.observe(state, (0.0, 0.0, 0.0), self._step_count, _ROWS))[0].astype(float)
        slices = observation_table(self.robot).slices
        terms = {name: observed[slices[name]] for name in ("angular_velocity", "joint_position", "joint_velocity")}
        terms["joint_position"] = terms["joint_position"] + self.robot.home_pose
        terms["quaternion"] = _tilted(observed[slices["projected_gravity"]], qpos[3:7])
        if self._suite is None:
            return terms, probe.read(_ROWS, self._step_count, 1)["accelerometer"][0]
        return terms, observation.readings()["sensor_accelerometer"][0]


def _make_simulation(
    robot: Robot, scenario: Scenario, profile: HardwareProfile | None, suite: SensorSuite | None
) -> Simulation:
    """Return the simulation of one robot at `RATE`, with the motor bandwidth of its hardware profile."""
    actuator = Actuator() if profile is None else Actuator(bandwidth=profile.actuator.bandwidth)
    imu = _AT_CENTRE if suite is None else (suite.imu.position, suite.imu.rotation)
    try:
        return Simulation(robot, scenario, SimulationConfig(control_rate=RATE, imu=imu, actuator=actuator))
    except ValueError as error:
        raise UsageError(f"--robot: {error}") from error


def _at_environment_rate(name: str) -> SensorSuite:
    """Return the sensors called `name` with the sample rate of the environment, `SENSOR_RATE`."""
    suite = sensor_suite(name)
    assert suite is not None, "a hardware profile without sensors"
    parts = {part: replace(getattr(suite, part), rate=SENSOR_RATE) for part in ("imu", "encoders", "feet", "torque")}
    return replace(suite, **parts)


def _reset_delay(delay: ActionDelay, episode: EpisodeSample) -> None:
    """Start an episode of the delay of motor commands, which has one row for each kind of command."""
    rows: NDArray[np.intp] = np.arange(len(MotorCommands._fields))
    delay.reset(rows, [episode] * len(rows))


def _tilted(gravity: Floats, true_quaternion: Floats) -> Floats:
    """Return the quaternion with roll and pitch of a measured gravity direction, and with the true yaw.

    Args:
        gravity: Measured unit vector of gravity, base frame, (3,).
        true_quaternion: True quaternion (w, x, y, z) of the trunk, (4,).

    Returns:
        Quaternion (w, x, y, z), (4,).
    """
    x, y, z = -gravity
    yaw = roll_pitch_yaw(true_quaternion)[2]
    roll = np.arctan2(y, z)
    pitch = np.arctan2(-x, np.hypot(y, z))
    return np.asarray(quaternion(np.array([roll]), np.array([pitch]), np.array([yaw]))[0])
