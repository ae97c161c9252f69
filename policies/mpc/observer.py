"""Delay compensation: estimates noise and delay, and predicts the state when the next targets act.

The joint targets of the past are known, so that the dynamics model of the robot (`servo_step`) predicts the motion
within a control period. `delay_estimator` compares the predicted joint speeds of several candidate delays with the
measured ones. `state_predictor` predicts the state over the estimated delay, with the targets that have not acted yet.
It is a Smith predictor of the whole body ("Closer control of loops with dead time", 1957). `reading_noise` estimates
the noise of the readings. Noisy readings are combined with their prediction by a Kalman filter (`state_filter`);
noise-free readings are used unchanged.
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
    """Estimates sensor noise and delay of n robots, and predicts their state when the next targets act.

    A control step calls `read`, then the contact estimate, then `correct`, `predict` and `record_stance`. The joint
    readings come from the true joint state or from encoders. Readings of the true joint state are filtered in `read`,
    with the recorded stance feet, because the contact estimate then needs the filtered state. Readings of encoders are
    filtered in `correct`, with the estimated contacts, because the contact estimate then needs the raw readings.

    Args:
        robot: Robot model; it supplies home pose and servo gains.
        dynamics: Dynamics model of the robot.
        period: Control period, s.
        actuator: Model of the joint motors.
        joint_delay_steps: Delay of the encoders, control steps; 0 if the readings come from the true joint state. With
            encoders, a joint speed is the difference of two angles divided by the control period.
    """

    _targets: Floats = per_robot(axis=1)
    """Joint targets of the last control periods, newest first, (number of periods, n, 12), rad."""
    _stance: Mask = per_robot(np.ones((MAX_DELAY_STEPS + 1, 4), np.bool_), axis=1)
    """True for the stance feet of the last control periods, newest first, (MAX_DELAY_STEPS + 1, n, 4)."""

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
        """Allocate fresh state for `num_envs` robots."""
        super().reset(num_envs)
        self._state = None

    def copy_state_from(self, mask: Mask, other: "DelayCompensator") -> None:
        """Copy estimates and state of another compensator for some robots. Both must have read an observation.

        Args:
            mask: Robots that receive a state, (n,) bool.
            other: Compensator with as many robots as `mask` selects.
        """
        super().copy_state_from(mask, other)
        assert self._state is not None
        assert other._state is not None
        self._state = replace_robots(self._state, mask.nonzero()[0], other._state)

    @property
    def delays(self) -> NDArray[np.int64]:
        """Estimated control steps from a reading until the joint target computed from it acts, (n,)."""
        return self.delay_estimator.delays

    @property
    def calibrating(self) -> Mask:
        """True for robots in calibration, because noise or delay of their readings is not known yet, (n,)."""
        return self.calibration.is_active

    @property
    def sample_count(self) -> NDArray[np.int64]:
        """Number of observations of each robot since its reset, (n,)."""
        return self.noise_estimator.sample_count

    def read(self, observation: NDArray[np.float32], wrench: Floats) -> MotionState:
        """Store the observation, update noise estimate and calibration, and compute the motion state.

        The readings are filtered first if they come from the true joint state. If encoders read the joints, the state
        is computed from the raw readings.

        Args:
            observation: Observations of n robots, (n, k).
            wrench: External wrench on the trunks, (n, 6), N and N·m.

        Returns:
            State at the time of the readings, with the joint targets that led to it.
        """
        self._observation = observation.astype(np.float64)
        # The last targets are read from the observation, because a residual policy or the safety layer may have changed
        # the targets that this controller returned.
        targets = self._observation[:, OBSERVATION["previous_action"]] + self._robot.home_pose
        self._targets = np.concatenate((targets[None], self._targets[:-1]))
        self._filtered_targets = self.servos.filtered_targets(self._targets)
        self._noise = self.noise_estimator.update(self._observation[:, SENSED])
        is_noisy = self._noise.max(axis=1) > 0.0
        self.calibration.update(self.sample_count, is_noisy, self.delay_estimator.is_identified)
        self.noise_unknown = self.calibrating & is_noisy
        """True for robots with noisy readings that are still in calibration, (n,).

        Their noise variance is not reliable yet."""
        if not self._has_encoders:
            self._filter_readings(self.delay_estimator.at_delay(self._stance), wrench)
        state = compute_motion_state(self._robot, self._dynamics, self._observation)
        if not self._has_encoders:
            self._state = state
        return state._replace(targets=self.delay_estimator.at_delay(self._filtered_targets))

    def correct(self, in_contact: Mask, wrench: Floats) -> None:
        """Filter encoder readings with the estimated contacts, and update the state.

        The method does nothing if the readings come from the true joint state, because `read` has filtered them.

        Args:
            in_contact: True for feet that touched the ground at the time of the readings, (n, 4).
            wrench: External wrench on the trunks, (n, 6), N and N·m.
        """
        if self._has_encoders:
            self._filter_readings(in_contact, wrench)
            self._state = compute_motion_state(self._robot, self._dynamics, self._observation)

    def predict(self, wrench: Floats, in_contact: Mask, slope: Floats, planned: Floats | None = None) -> MotionState:
        """Predict the state at the time when the next joint targets act; called after `read` and `correct`.

        Args:
            wrench: External wrench on the trunks, (n, 6), N and N·m.
            in_contact: True for feet that touched the ground at the time of the readings, (n, 4).
            slope: Slope of the ground forward and to the left, rise per metre, (2, n).
            planned: Observations with joint angles and speeds as planned by the controller, (n, k), or None. The
                predicted joints are kept near the planned ones if the estimated delay is `joint_delay_steps`.

        Returns:
            Predicted state of n robots.
        """
        assert self._state is not None
        ground = self.state_predictor.locate_ground(self._state, in_contact, slope)
        return self.state_predictor.predict(
            self._state, self._observation, self.delays, self._filtered_targets, wrench, ground, planned
        )

    def record_stance(self, stance: Mask) -> None:
        """Store the mask of `stance` feet, (n, 4), of the control period that begins.

        All feet of a robot in calibration are stored as stance feet, because it stands.
        """
        stance = stance | self.calibrating[:, None]
        self._stance = np.concatenate((stance[None], self._stance[:-1]))

    def _filter_readings(self, stance: Mask, wrench: Floats) -> None:
        """Update the delay estimate, and filter the readings of the present observation in place.

        `stance`: feet that are assumed in contact, (n, 4); `wrench`: external wrench on the trunks, (n, 6), N and N·m.
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
            before: State one control step before the readings.
            velocities: Predicted generalised velocities, (MAX_DELAY_STEPS + 1, n, 18), m/s and rad/s. Row k belongs to
                the candidate delay of k control steps.
            readings: Readings of the robots, see `policies.mpc.readings`, (n, 33).

        Returns:
            Squared error, mean over the joints, for each candidate delay, (MAX_DELAY_STEPS + 1, n), rad²/s².
        """
        speeds = velocities[..., 6:]
        if self._has_encoders:  # because a speed from two encoder angles is the mean over the control period
            speeds = 0.5 * (before.generalised_velocity[:, 6:] + speeds)
        error = speeds - readings[:, JOINT_VELOCITY]
        errors: Floats = (error * error).sum(axis=2) / error.shape[2]
        return errors
