"""Delay compensation: estimates sensor noise and delay, and predicts the state when the next joint targets act.

The module `servo_step` predicts the motion within a control period from the joint targets, by a dynamics model of the
robot. `delay_estimator` compares the predicted joint speeds of several candidate delays with the measured joint speeds.
`state_predictor` predicts the state over the estimated delay, with the joint targets that have been sent but have not
acted yet. It is a Smith predictor of the whole body ("Closer control of loops with dead time", 1957). `reading_noise`
estimates the noise of the sensor readings. `state_filter` is a Kalman filter that combines noisy readings with their
prediction. Noise-free readings are used unchanged.
"""

import numpy as np
from numpy.typing import NDArray

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.contact.servo_model import ServoModel
from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from policies.mpc.calibration import Calibration
from policies.mpc.delay_estimator import MAX_DELAY_STEPS, DelayEstimator
from policies.mpc.motion import replace_robots
from policies.mpc.reading_noise import NoiseEstimator
from policies.mpc.readings import JOINT_VELOCITY, SENSED, normalise_gravity, predict_readings
from policies.mpc.servo_step import compute_response
from policies.mpc.state_filter import StateFilter
from policies.mpc.state_predictor import StatePredictor
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot


class DelayCompensator(PerRobotState):
    """Estimates sensor noise and delay of n robots, and predicts their state when the next joint targets act.

    A control step first calls `read`. It then updates the contact estimate (`ContactEstimator`), and finally calls
    `correct`, `predict` and `record_stance`. The joint readings come from the true joint state or from encoders.
    Readings of the true joint state are filtered in `read`, because the contact estimate needs the filtered state. This
    filter uses the stance feet from `record_stance`. Readings of encoders are filtered in `correct`, because the
    contact estimate needs the raw encoder readings. This filter uses the estimated contacts.

    Args:
        robot: Robot model; it supplies home pose and servo gains.
        dynamics: Dynamics model of the robot.
        period: Control period, s.
        actuator: Model of the joint motors.
        joint_delay_steps: Delay of the joint encoders, control steps; 0 if the readings come from the true joint state.
            With encoders, a joint speed is the difference of two angles divided by the control period.
    """

    _targets: Floats = per_robot(axis=1)
    """Joint targets of the last m control periods, newest first, (m, n, 12), rad.

    m is large enough for the longest candidate delay plus the time in which the motors still follow an earlier
    target."""
    _stance: Mask = per_robot(np.ones((MAX_DELAY_STEPS + 1, 4), np.bool_), axis=1)
    """True for feet in stance, for each of the last control periods, newest first, (MAX_DELAY_STEPS + 1, n, 4)."""

    def __init__(
        self, robot: Robot, dynamics: Dynamics, period: float, actuator: Actuator = IDEAL, joint_delay_steps: int = 0
    ) -> None:
        self._robot = robot
        self._dynamics = dynamics
        self._period = period
        self._has_encoders = joint_delay_steps > 0
        self.servos = ServoModel(robot, actuator, period)
        self.noise_estimator = NoiseEstimator(period)
        self.delay_estimator = DelayEstimator(period, joint_delay_steps)
        self.calibration = Calibration(robot, identifies_delay=not self._has_encoders)
        self.state_filter = StateFilter(period, has_encoders=self._has_encoders)
        self.state_predictor = StatePredictor(robot, dynamics, period, joint_delay_steps)
        self._state: MotionState | None = None
        target_history = np.tile(robot.home_pose, (MAX_DELAY_STEPS + len(self.servos.target_weights), 1))
        super().__init__(_targets=target_history)

    def reset(self, num_envs: int) -> None:
        """Reset the compensator: allocate the initial noise, delay and filter states for `num_envs` robots."""
        super().reset(num_envs)
        self._state = None

    def copy_state_from(self, mask: Mask, other: "DelayCompensator") -> None:
        """Copy the estimates and the motion state of all robots of another compensator to some robots of this one.

        Both compensators must have read an observation before.

        Args:
            mask: True for robots of this compensator that receive a state, (n,).
            other: Compensator with one robot for each True in `mask`.
        """
        super().copy_state_from(mask, other)
        assert self._state is not None
        assert other._state is not None
        self._state = replace_robots(self._state, mask.nonzero()[0], other._state)

    @property
    def delays(self) -> NDArray[np.int64]:
        """Estimated delay from a sensor reading until the joint target computed from it acts, (n,), control steps."""
        return self.delay_estimator.delays

    @property
    def calibrating(self) -> Mask:
        """True for robots in calibration, because the noise or the delay of their readings is not known yet, (n,)."""
        return self.calibration.is_active

    @property
    def sample_count(self) -> NDArray[np.int64]:
        """Number of observations of each robot since its reset, (n,)."""
        return self.noise_estimator.sample_count

    def read(self, observation: NDArray[np.float32], wrench: Floats) -> MotionState:
        """Store the observations, update noise estimate and calibration, and compute the motion states.

        If the readings come from the true joint state, noisy readings are filtered first. If encoders read the joints,
        the state is computed from the raw readings.

        Args:
            observation: Observations of n robots, (n, k).
            wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
                centre, base frame, N·m.

        Returns:
            State of n robots at the time of the readings, with the joint targets that led to this state.
        """
        self._observation = observation.astype(np.float64)
        # The last joint targets are read from the observation, because a residual policy or the safety layer may have
        # changed the targets that this controller returned.
        targets = self._observation[:, OBSERVATION["previous_action"]] + self._robot.home_pose
        self._targets = np.concatenate((targets[None], self._targets[:-1]))
        self._filtered_targets = self.servos.filtered_targets(self._targets)
        self._noise = self.noise_estimator.update(self._observation[:, SENSED])
        is_noisy = self._noise.max(axis=1) > 0.0
        self.calibration.update(self.sample_count, is_noisy, self.delay_estimator.is_identified)
        self.noise_unknown = self.calibrating & is_noisy
        """True for robots that have noisy readings and are still in calibration, (n,).

        The estimated noise variance of these robots is not reliable yet."""
        if not self._has_encoders:
            self._filter_readings(self.delay_estimator.at_delay(self._stance), wrench)
        state = compute_motion_state(self._robot, self._dynamics, self._observation)
        if not self._has_encoders:
            self._state = state
        return state._replace(targets=self.delay_estimator.at_delay(self._filtered_targets))

    def correct(self, in_contact: Mask, wrench: Floats) -> None:
        """Filter the encoder readings with the estimated contacts, and recompute the motion state from them.

        The method does nothing if the readings come from the true joint state, because `read` has filtered them.

        Args:
            in_contact: True for feet that touched the ground at the time of the readings, (n, 4).
            wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
                centre, base frame, N·m.
        """
        if self._has_encoders:
            self._filter_readings(in_contact, wrench)
            self._state = compute_motion_state(self._robot, self._dynamics, self._observation)

    def predict(self, wrench: Floats, in_contact: Mask, slope: Floats, planned: Floats | None = None) -> MotionState:
        """Predict the state at the time when the next joint targets act; called after `read` and `correct`.

        Args:
            wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
                centre, base frame, N·m.
            in_contact: True for feet that touched the ground at the time of the readings, (n, 4).
            slope: Slope of the ground forward and to the left, rise per metre, (2, n).
            planned: Observations with the joint angles and speeds that the controller has planned for the predicted
                time, (n, k), or None. If the estimated delay is `joint_delay_steps`, the predicted joint angles and
                speeds are averaged with the planned ones.

        Returns:
            Predicted state of n robots.
        """
        assert self._state is not None
        ground = self.state_predictor.locate_ground(self._state, in_contact, slope)
        return self.state_predictor.predict(
            self._state, self._observation, self.delays, self._filtered_targets, wrench, ground, planned
        )

    def record_stance(self, stance: Mask) -> None:
        """Store the mask of feet that are in `stance`, (n, 4), in the control period that begins.

        All feet of a robot in calibration are stored as stance feet, because this robot stands.
        """
        stance = stance | self.calibrating[:, None]
        self._stance = np.concatenate((stance[None], self._stance[:-1]))

    def _filter_readings(self, stance: Mask, wrench: Floats) -> None:
        """Update the delay estimate, and filter the sensor readings in the present observation in place.

        `stance`: True for feet that are assumed in contact, (n, 4); `wrench`: external force, N, and moment, N·m, on
        the trunks, (n, 6).
        """
        before = self._state
        if before is None:
            return
        readings = self._observation[:, SENSED]
        velocities = compute_response(self._robot, before, stance, wrench, self._period).velocities(
            self._filtered_targets
        )
        errors = self._prediction_errors(before, velocities, readings)
        is_excited = ~self.calibration.measures_noise
        self.delay_estimator.update(errors, self._noise[:, -1], self.sample_count, is_excited)
        filtered_robots = self.state_filter.needs_filter(self._noise)
        if filtered_robots.any():
            velocity = self.delay_estimator.at_delay(velocities)
            predicted = predict_readings(self._robot, before, velocity, self._period)
            filtered = self.state_filter.correct(readings, predicted, self._noise, self.sample_count)
            readings[filtered_robots] = filtered[filtered_robots]
        self.state_filter.clear_covariance(~filtered_robots)
        normalise_gravity(readings)

    def _prediction_errors(self, before: MotionState, velocities: Floats, readings: Floats) -> Floats:
        """Return the prediction error of the joint speeds for each candidate delay.

        Args:
            before: State of n robots one control step before the readings.
            velocities: Predicted generalised velocities, (MAX_DELAY_STEPS + 1, n, 18): trunk velocity, m/s, angular
                velocity and joint speeds, rad/s. Row k belongs to the candidate delay of k control steps.
            readings: Sensor readings of the robots, see `policies.mpc.readings`, (n, 33).

        Returns:
            Squared error, mean over the joints, for each candidate delay, (MAX_DELAY_STEPS + 1, n), rad²/s².
        """
        speeds = velocities[..., 6:]
        if self._has_encoders:  # because a speed from two encoder angles is the mean speed over the control period
            speeds = 0.5 * (before.generalised_velocity[:, 6:] + speeds)
        error = speeds - readings[:, JOINT_VELOCITY]
        errors: Floats = (error * error).sum(axis=2) / error.shape[2]
        return errors
