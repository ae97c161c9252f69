"""Error-state Kalman filter of attitude, velocity, IMU biases and foot positions of n robots.

The filter assumes that feet in contact do not move. The module `kalman_models` contains the process model, its
derivatives, and the contact model. The measurement is the position of each foot from the joint encoders. The noise
covariances follow from the sensor errors (`SensorSuite`) and from `KalmanParameters`. Some sensor errors are constant
during an episode: the filter estimates the biases of the IMU, but treats the errors of the IMU's position and mounting
and of the encoder zeros as noise.

The process noise of a foot position depends on the contact:

- A foot that is probably not in contact gets a large noise, mostly along the ground.
- A foot that has just touched down, or that is under a changing load, gets a smaller noise.
- A foot may be farther from its predicted position than its covariance explains, for example because it slides. The
  noise of this foot is increased in proportion to the unexplained squared distance.

The filter processes each sample in four phases: `predict`, `contact_update`, `measurement_update`, `extrapolate`.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from quad_env.columns import Array, EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew
from quad_env.robots.kinematics import foot_jacobians, foot_positions
from quad_env.robots.robot import Robot
from quad_env.sensing import kalman_models
from quad_env.sensing.estimator import AlignedReadings, unit
from quad_env.sensing.kalman_models import (
    ACCELEROMETER_BIAS,
    CONTACT_PARAMETERS,
    FEET,
    GYRO_BIAS,
    IDENTITY,
    TILT,
    VELOCITY,
    NominalState,
    StepMeasurements,
    contact_probability,
    exp_so3,
    matvec,
)
from quad_env.sensing.suite import SensorSuite


@dataclass(frozen=True)
class KalmanParameters:
    """Tuning parameters of `KalmanFilter`: process noise that the data sheets of the sensors do not give.

    All values were tuned on episodes that are reserved for searches, with the policies `trot` and `trot_feedback`. The
    scenarios were flat ground, rough ground, and walking straight ahead.
    """

    gyro_interpolation_noise: float = 0.35
    """Error of the mean angular velocity in a control period, as a fraction of the gyroscope's change.

    The error is a standard deviation. The change is the difference between the gyroscope readings at the end and at the
    start of the control period. A larger value makes the filter trust the attitude less while the angular velocity of
    the trunk changes.
    """
    accelerometer_scale_noise: float = 0.01
    """Standard deviation of the accelerometer's error, as a fraction of the trunk's acceleration.

    The error covers scale errors, misalignment, and the averaging of readings while the trunk turns. A larger value
    makes the filter trust the accelerometer less during hard impacts.
    """
    lever_arm_noise_gain: float = 0.5
    """Fraction of the IMU's distance from the trunk's centre that is treated as noise in each sample.

    When the trunk turns, the IMU moves relative to the trunk's centre. This velocity averages out over a stride, so
    that only a fraction of the velocity acts as noise. A larger value makes the filter trust the accelerometer less
    while the trunk turns.
    """
    contact_velocity_std: float = 0.015
    """Standard deviation of the velocity of a stance foot along each axis, m/s.

    A larger value makes the velocity estimate follow the legs less.
    """
    encoder_offset_noise_gain: float = 8.0
    """Factor on the standard deviation of the foot position noise that the zero offsets of the encoders cause.

    The factor is above 1, because this error is nearly constant during a stance phase and therefore does not average
    out.
    """
    touchdown_velocity_std: float = 1.2
    """Standard deviation of the vertical velocity of a foot at touchdown, m/s.

    Soft ground sinks under a new contact and rises again. A larger value makes the filter ignore the height of a new
    contact for longer.
    """
    touchdown_noise_decay: float = 0.013
    """Time constant of the exponential decay of `touchdown_velocity_std` after a touchdown, s."""
    ground_compliance: float = 2e-4
    """Standard deviation of a stance foot's vertical motion, m, per change of the accelerometer reading, m/s².

    The unit is s². In every stance phase, the load of a foot rises to several times its static load, so that the foot
    sinks and rises again. A larger value makes the filter trust the foot heights less while the load changes.
    """
    swing_horizontal_velocity_std: float = 30.0
    """Standard deviation of the velocity of a swing foot along the ground, m/s.

    Swing feet move forward on average, and fast after a push. The value is large so that swing feet do not bias the
    velocity estimate. The standard deviation of the vertical velocity is `ContactParameters.swing_speed`, which is
    smaller because a foot that rises comes down again. The smaller value keeps the vertical velocity accurate if the
    ground lifts the stance feet.
    """
    slip_innovation_gain: float = 4.0
    """Factor on the extra position variance of a stance foot that is farther from its prediction than expected.

    The innovation is the measured minus the predicted position of the foot. The squared innovation minus its
    expected value, divided by 3, gives the extra variance along each axis. This variance is multiplied by the factor
    and by the contact probability. A larger factor makes the filter trust slipping feet less.
    """
    accelerometer_bias_random_walk: float = 0.014
    """Standard deviation of the random walk of the accelerometer bias, m/s² per √s.

    This noise covers unmodelled errors that look like a changing bias.
    """
    slip_velocity_inflation: float = 0.05
    """Velocity noise that a foot adds if it reads contact but seems to move, as a fraction of its speed.

    The product of this fraction and the speed is the standard deviation of noise that is added to the trunk's velocity
    in each sample. Only feet that have read contact for longer than `min_contact_duration` add this noise. The foot may
    in fact be at rest, while the estimated velocity of the trunk is wrong.
    """
    min_contact_duration: float = 0.025
    """Duration of an uninterrupted contact reading after which `slip_velocity_inflation` applies to a foot, s."""
    initial_velocity_std: float = 0.2
    """Standard deviation of the trunk velocity along each axis at the start of an episode, m/s."""
    acceleration_extrapolation_gain: float = 0.8
    """Fraction of the trunk acceleration's last change that is added to predict the acceleration until now.

    The prediction covers the delay of the sensor readings, see `KalmanFilter.extrapolate`.
    """
    missing_sample_std: float = 1e3
    """Standard deviation of the joint angles in a control step that has no new encoder sample, rad.

    The value is very large, so that old angles do not change the estimate.
    """


PARAMETERS = KalmanParameters()


class SensorErrors(NamedTuple):
    """Standard deviations of the sensor errors, computed by `sensor_errors` from a sensor suite.

    The noise and bias values are above 0, so that the covariance matrices can be inverted.
    """

    gyro: float
    """Standard deviation of the white noise of the gyroscope, rad/s."""
    gyro_bias: float
    """Standard deviation of the gyroscope's bias over episodes, rad/s."""
    accelerometer: float
    """Standard deviation of the white noise of the accelerometer, m/s²."""
    accelerometer_bias: float
    """Standard deviation of the accelerometer's bias over episodes, m/s²."""
    angle: float
    """Standard deviation of the sum of noise and rounding error in an encoder sample, rad."""
    zero: float
    """Standard deviation of an encoder's zero offset over episodes, rad."""
    lever: float
    """Root mean square of the three components of the IMU's position error, m."""
    mounting: float
    """Root mean square of the three angles of the IMU's mounting error, rad."""


class FootContactState(NamedTuple):
    """Estimated contact of each foot of n robots at the last sample."""

    probability: Array
    """Probability that each foot of n robots is in contact with the ground, (n, 4)."""
    stance_time: Array
    """Time since touchdown of each foot of n robots, weighted by the contact probability, (n, 4), s."""
    reading_time: Array
    """Time for which each foot's force sensor has read contact without interruption, for n robots, (n, 4), s."""
    jacobians: Array
    """Jacobian of each foot's position with respect to its leg's joint angles, base frame, (n, 4, 3, 3), m/rad.

    The dimensions are n robots, four legs, the coordinates x, y, z, and the hip, thigh and calf angles.
    """


class PreviousSample(NamedTuple):
    """Sensor readings of n robots at the last sample, and accelerations that follow from the readings."""

    gyro: Array
    """Angular velocity that the gyroscopes of n robots read, base frame, (n, 3), rad/s."""
    joints: Array
    """Hip, thigh and calf angle of each leg of n robots, from the encoders, (n, 4, 3), rad."""
    specific_force: Array
    """Accelerometer reading of n robots minus the estimated bias, base frame, (n, 3), m/s²."""
    acceleration: Array
    """Acceleration of the trunks of n robots, base frame, (n, 3), m/s²."""


Rows = TypeVar("Rows", NominalState, FootContactState, PreviousSample)
"""Type variable for the named tuples that store the filter's state in arrays with one row per robot."""


class Workspace(NamedTuple):
    """Matrices that every sample of n robots overwrites; arrays of this size are slow to allocate for each sample."""

    covariance: Array
    """Covariance of the error of n states, without motion of the feet, (n, 24, 24)."""
    transition: Array
    """Derivative of the error of n states with respect to the error one sample before, (n, 24, 24).

    After the prediction, this array is the covariance of the error with the possible motion of the feet.
    """
    product: Array
    """Intermediate products of n matrices, (n, 24, 24)."""
    innovation_covariance: Array
    """Covariance of the innovation of all feet of n robots, (n, 12, 12), m²."""


class Prediction(NamedTuple):
    """Predicted state of k robots at a new sample, before the measured foot positions correct the state."""

    state: NominalState
    """Predicted gravity, velocity, IMU biases and foot positions of k robots, base frame."""
    covariance: Array
    """Covariance of the error of k predicted states, under the assumption that no foot has moved, (k, 24, 24).

    `kalman_models` defines the 24 components of the error: tilt, velocity, IMU biases and foot positions. The next
    sample overwrites the array.
    """
    acceleration: Array
    """Acceleration of the trunks of k robots at the new sample, base frame, (k, 3), m/s²."""
    previous_acceleration: Array
    """Acceleration of the trunks of k robots at the previous sample, in the new base frame, (k, 3), m/s²."""
    force_change: Array
    """Magnitude of the accelerometer reading's change since the last sample, for k robots, (k, 1, 1, 1), m/s²."""


class FootMeasurement(NamedTuple):
    """Measurement of the Kalman filter: foot positions of k robots from the joint encoders."""

    innovation: Array
    """Measured minus predicted position of each foot of k robots, base frame, (k, 4, 3), m."""
    noise: Array
    """Covariance of the measured position of each foot of k robots, base frame, (k, 4, 3, 3), m²."""
    covariance: Array
    """Covariance of the error of k predicted states, including the possible motion of the feet, (k, 24, 24).

    `kalman_models` defines the 24 components of the error: tilt, velocity, IMU biases and foot positions. The next
    sample overwrites the array.
    """


def sensor_errors(suite: SensorSuite) -> SensorErrors:
    """Compute the standard deviations of the sensor errors of a sensor `suite`.

    The filter does not know the direction of the IMU's position error and the axis of its mounting error. The filter
    gets only the root mean square of the components of each error.
    """
    imu = suite.imu
    encoders = suite.encoders
    return SensorErrors(
        gyro=max(imu.gyro_noise, 1e-4),
        gyro_bias=max(imu.gyro_bias, 1e-5),
        accelerometer=max(imu.accelerometer_noise, 1e-3),
        accelerometer_bias=max(imu.accelerometer_bias, 1e-3),
        angle=max(float(np.hypot(encoders.noise, encoders.step / np.sqrt(12.0))), 1e-4),
        zero=encoders.zero_offset,
        lever=float(np.sqrt(np.mean(np.square(imu.position)))),
        mounting=float(np.sqrt(np.mean(np.square(imu.rotation)))),
    )


class KalmanFilter:
    """Error-state Kalman filter that estimates gravity, velocity and gyro bias of n robots, base frame.

    Args:
        robot: Geometry of the robots.
        suite: Sensors of the robots.
        num_envs: Number of robots.
        dt: Control period, s.
        delay_steps: Age of the sensor readings when `update` receives them, control steps.

    Attributes:
        gravity: Unit vector of gravity at the present time, (n, 3).
        velocity: Velocity of the trunk's centre at the present time, (n, 3), m/s.
        gyro_bias: Bias of the gyroscope, (n, 3), rad/s.
        nominal: Estimated state at the time of the readings, which are `delay_steps` control steps old.
        contact: Estimated contact of each foot at the time of the readings.
        previous: Sensor readings of the last sample, and the accelerations that follow from them.
    """

    def __init__(self, robot: Robot, suite: SensorSuite, num_envs: int, dt: float, delay_steps: int) -> None:
        self._robot = robot
        self._dt = dt
        self._delay = delay_steps * dt
        self._errors = sensor_errors(suite)
        legs = len(robot.leg_names)
        size = kalman_models.error_dim(robot)
        self.gravity = np.zeros((num_envs, 3))
        self.velocity = np.zeros((num_envs, 3))
        self.gyro_bias = np.zeros((num_envs, 3))
        self.nominal = NominalState(
            gravity=np.zeros((num_envs, 3)),
            velocity=np.zeros((num_envs, 3)),
            gyro_bias=np.zeros((num_envs, 3)),
            accelerometer_bias=np.zeros((num_envs, 3)),
            feet=np.zeros((num_envs, legs, 3)),
        )
        self.contact = FootContactState(
            probability=np.zeros((num_envs, legs)),
            stance_time=np.zeros((num_envs, legs)),
            reading_time=np.zeros((num_envs, legs)),
            jacobians=np.zeros((num_envs, legs, 3, 3)),
        )
        self.previous = PreviousSample(
            gyro=np.zeros((num_envs, 3)),
            joints=np.zeros((num_envs, legs, 3)),
            specific_force=np.zeros((num_envs, 3)),
            acceleration=np.zeros((num_envs, 3)),
        )
        self._covariance = np.zeros((num_envs, size, size))
        self._workspace = Workspace(
            covariance=np.zeros((num_envs, size, size)),
            transition=np.zeros((num_envs, size, size)),
            product=np.zeros((num_envs, size, size)),
            innovation_covariance=np.zeros((num_envs, 3 * legs, 3 * legs)),
        )

    @property
    def covariance(self) -> Array:
        """Covariance of the error of the state `nominal` of n robots, including the IMU's mounting error, (n, 24, 24).

        The module `kalman_models` defines the 24 components: tilt, velocity, IMU biases and foot positions.
        """
        out = self._covariance.copy()
        out[:, TILT, TILT] += self._errors.mounting**2 * IDENTITY
        return out

    def reset(self, env_ids: EnvIndices, specific_force: Array, readings: AlignedReadings) -> None:
        """Reset the estimates of robots that stand still at the start of an episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            specific_force: Mean accelerometer reading while the robots stand still, base frame, (k, 3), m/s².
            readings: First sensor readings of the episode, of the k robots.
        """
        joints = self._leg_joints(readings)
        gravity = -unit(specific_force)
        zero = np.zeros_like(specific_force)
        feet = self._robot.hip_positions + foot_positions(self._robot, joints)
        self._covariance[env_ids] = self._initial_covariance(gravity)
        _assign(self.nominal, env_ids, NominalState(gravity, zero, zero, zero, feet))
        no_time = np.zeros(readings.contact.shape)
        jacobians = foot_jacobians(self._robot, joints)
        probability = np.where(readings.contact, 0.5, 0.0)
        contact = FootContactState(probability, no_time, no_time, jacobians)
        _assign(self.contact, env_ids, contact)
        _assign(self.previous, env_ids, PreviousSample(readings.gyro, joints, specific_force, zero))
        self.gravity[env_ids] = gravity
        self.velocity[env_ids] = 0.0
        self.gyro_bias[env_ids] = 0.0

    def update(self, readings: AlignedReadings, env_ids: EnvIndices) -> None:
        """Advance the estimates of k robots by one control period.

        Args:
            readings: Time-aligned readings of k robots at the end of the period.
            env_ids: Indices of the k robots, (k,).
        """
        prediction = self.predict(readings, env_ids)
        measurement = self.contact_update(prediction, readings, env_ids)
        self.measurement_update(prediction.state, measurement, env_ids)
        self.extrapolate(prediction, readings.gyro, env_ids)

    def predict(self, readings: AlignedReadings, env_ids: EnvIndices) -> Prediction:
        """Propagate the state and its covariance by one control period (prediction step of the filter).

        The inputs of the process model are the IMU readings and the joint angles.

        Args:
            readings: Readings of k robots at the end of the period.
            env_ids: Indices of the k robots, (k,).

        Returns:
            Predicted state and covariance, under the assumption that no foot has moved on the ground.
        """
        state = _select(self.nominal, env_ids)
        previous = _select(self.previous, env_ids)
        measurements = self._step_measurements(previous, readings)
        rotated = kalman_models.rotate_state(state, measurements, self._dt)
        predicted = kalman_models.predict(self._robot, state, rotated, self._dt)
        force = rotated.specific_force
        acceleration = matvec(0.5 * (rotated.rotation + IDENTITY), force) + GRAVITY * predicted.gravity
        transition = self._workspace.transition[: len(env_ids)]
        kalman_models.error_transition_matrix(self._robot, state, measurements, rotated, self._dt, out=transition)
        covariance = self._predict_covariance(transition, readings.gyro - previous.gyro, acceleration, env_ids)
        force_change = np.sqrt(_squared_length(force - previous.specific_force))[..., None]
        previous_acceleration = matvec(rotated.rotation, previous.acceleration)
        _assign(self.previous, env_ids, PreviousSample(readings.gyro, measurements.joints, force, acceleration))
        return Prediction(predicted, covariance, acceleration, previous_acceleration, force_change)

    def contact_update(self, prediction: Prediction, readings: AlignedReadings, env_ids: EnvIndices) -> FootMeasurement:
        """Update the contact probabilities, and add the motion of the feet to the predicted covariance.

        Args:
            prediction: Result of `predict`.
            readings: Readings that were passed to `predict`.
            env_ids: Indices of the k robots, (k,).

        Returns:
            Innovation of the foot positions, measurement noise, and predicted covariance with the motion of the feet.
        """
        robot = self._robot
        gravity = prediction.state.gravity
        vertical = gravity[:, None, :, None] * gravity[:, None, None, :]
        joints = self.previous.joints[env_ids]
        jacobians = foot_jacobians(robot, joints)
        stance_noise = self._stance_noise(prediction.force_change, jacobians, vertical, env_ids)
        noise = self._encoder_noise(readings, jacobians)
        innovation = robot.hip_positions + foot_positions(robot, joints) - prediction.state.feet
        expected = _foot_blocks(prediction.covariance[:, FEET, FEET]) + stance_noise + noise
        contact = self._update_contact(readings, innovation, expected, jacobians, env_ids)
        covariance = self._inflate_velocity(prediction.covariance, contact, innovation)
        swing_noise = _swing_covariance(contact.probability, innovation, expected, vertical, self._dt)
        _foot_blocks(covariance[:, FEET, FEET])[:] += stance_noise + swing_noise
        return FootMeasurement(innovation, noise, covariance)

    def measurement_update(self, predicted: NominalState, measurement: FootMeasurement, env_ids: EnvIndices) -> None:
        """Correct the state and its covariance with the measured foot positions (Kalman update).

        Args:
            predicted: Predicted state of k robots.
            measurement: Result of `contact_update`.
            env_ids: Indices of the k robots, (k,).
        """
        covariance = measurement.covariance
        count = len(env_ids)
        innovation_covariance = self._workspace.innovation_covariance[:count]
        np.copyto(innovation_covariance, covariance[:, FEET, FEET])
        _foot_blocks(innovation_covariance)[:] += measurement.noise
        gain = np.linalg.solve(innovation_covariance, covariance[:, FEET])
        error = (measurement.innovation.reshape(count, 1, -1) @ gain)[:, 0]
        corrected = np.matmul(covariance[:, FEET].mT, gain, out=self._workspace.product[:count])
        np.subtract(covariance, corrected, out=corrected)
        symmetric = np.add(corrected, corrected.mT, out=self._workspace.covariance[:count])
        symmetric *= 0.5
        self._covariance[env_ids] = symmetric
        _assign(self.nominal, env_ids, kalman_models.inject_error(predicted, error))

    def extrapolate(self, prediction: Prediction, gyro: Array, env_ids: EnvIndices) -> None:
        """Extrapolate gravity and velocity from the time of the readings to the present time.

        The angular velocity is assumed to be constant. The acceleration is assumed to be the last acceleration plus its
        last change times `KalmanParameters.acceleration_extrapolation_gain`.

        Args:
            prediction: Result of `predict`.
            gyro: Gyroscope readings of k robots, base frame, (k, 3), rad/s.
            env_ids: Indices of the k robots, (k,).
        """
        state = _select(self.nominal, env_ids)
        acceleration = prediction.acceleration
        change = PARAMETERS.acceleration_extrapolation_gain * (acceleration - prediction.previous_acceleration)
        velocity_change = self._delay * (acceleration + change)
        rotation = exp_so3(-self._delay * (gyro - state.gyro_bias))
        self.gravity[env_ids] = unit(matvec(rotation, state.gravity))
        self.velocity[env_ids] = matvec(rotation, state.velocity + velocity_change)
        self.gyro_bias[env_ids] = state.gyro_bias

    def _leg_joints(self, readings: AlignedReadings) -> Array:
        """Return the joint angles in the `readings` of k robots, grouped by leg, (k, 4, 3), rad."""
        return readings.joints.reshape(-1, *self.previous.joints.shape[1:])

    def _step_measurements(self, previous: PreviousSample, readings: AlignedReadings) -> StepMeasurements:
        """Return the process model's inputs for the control period from the `previous` sample to `readings`."""
        mean_gyro = 0.5 * (previous.gyro + readings.gyro)
        return StepMeasurements(mean_gyro, readings.accelerometer, previous.joints, self._leg_joints(readings))

    def _initial_covariance(self, gravity: Array) -> Array:
        """Return the covariance of the errors of k states at the start of an episode, (k, 24, 24).

        `gravity` is the unit vector of gravity for each of k robots, base frame, (k, 3). The errors of tilt and
        accelerometer bias are correlated, because the initial gravity is computed from the accelerometer reading, which
        contains the bias.
        """
        errors = self._errors
        bias_to_tilt = skew(gravity) / GRAVITY
        bias = errors.accelerometer_bias**2 * IDENTITY
        out = np.zeros((len(gravity), *self._covariance.shape[1:]))
        out[:, TILT, TILT] = bias_to_tilt @ bias @ bias_to_tilt.mT + 1e-6 * IDENTITY
        out[:, TILT, ACCELEROMETER_BIAS] = bias_to_tilt @ bias
        out[:, ACCELEROMETER_BIAS, TILT] = (bias_to_tilt @ bias).mT
        out[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] = bias
        out[:, VELOCITY, VELOCITY] = PARAMETERS.initial_velocity_std**2 * IDENTITY
        out[:, GYRO_BIAS, GYRO_BIAS] = errors.gyro_bias**2 * IDENTITY
        out[:, FEET, FEET] = 1e-4 * np.eye(out.shape[-1] - FEET.start)
        return out

    def _predict_covariance(
        self, transition: Array, gyro_change: Array, acceleration: Array, env_ids: EnvIndices
    ) -> Array:
        """Propagate the covariance by one control period, and add the noise of the IMU; return the result.

        The result is the covariance of the errors of k states, (k, 24, 24). `transition` is the derivative of each
        error with respect to the error one control period earlier, (k, 24, 24). `gyro_change` is the change of the
        gyroscope reading in the period, base frame, (k, 3), rad/s. `acceleration` is the acceleration of the trunk,
        base frame, (k, 3), m/s². `env_ids` are the indices of the k robots.
        """
        out = self._workspace.covariance[: len(env_ids)]
        product = self._workspace.product[: len(env_ids)]
        self._covariance.take(env_ids, axis=0, out=out, mode="clip")  # other modes make a copy of `out`
        np.matmul(transition, out, out=product)
        np.matmul(product, transition.mT, out=out)
        gyro_gain = transition[:, :, GYRO_BIAS].copy()
        gyro_gain[:, GYRO_BIAS] = 0.0
        gyro_variance = PARAMETERS.gyro_interpolation_noise**2 / 3 * _squared_length(gyro_change)
        out += np.matmul(gyro_gain, (self._errors.gyro**2 + gyro_variance) * gyro_gain.mT, out=product)
        force_gain = transition[:, :, ACCELEROMETER_BIAS].copy()
        force_gain[:, ACCELEROMETER_BIAS] = 0.0
        force_covariance = self._force_covariance(gyro_change, acceleration)
        out += np.matmul(force_gain @ force_covariance, force_gain.mT, out=product)
        random_walk = PARAMETERS.accelerometer_bias_random_walk**2 * self._dt
        out[:, ACCELEROMETER_BIAS, ACCELEROMETER_BIAS] += random_walk * IDENTITY
        return out

    def _force_covariance(self, gyro_change: Array, acceleration: Array) -> Array:
        """Return the covariance of the accelerometer reading, base frame, (k, 3, 3), m²/s⁴.

        `gyro_change` is the change of the gyroscope reading in the control period, base frame, (k, 3), rad/s.
        `acceleration` is the acceleration of the trunk, base frame, (k, 3), m/s².
        """
        errors = self._errors
        scale_variance = PARAMETERS.accelerometer_scale_noise**2 * _squared_length(acceleration)
        force_variance = errors.accelerometer**2 + scale_variance
        lever = skew(gyro_change)
        lever_arm_gain = PARAMETERS.lever_arm_noise_gain * errors.lever / self._dt
        out: Array = force_variance * IDENTITY + lever_arm_gain**2 * (lever @ lever.mT)
        return out

    def _stance_noise(self, force_change: Array, jacobians: Array, vertical: Array, env_ids: EnvIndices) -> Array:
        """Return the process noise covariance of each stance foot's position, base frame, (k, 4, 3, 3), m².

        The filter adds this covariance in every control period. `force_change` is the magnitude of the change of the
        accelerometer reading of each of k robots, (k, 1, 1, 1), m/s². `jacobians` are the foot Jacobians, (k, 4, 3, 3),
        m/rad. `vertical` is the projection matrix onto the vertical, base frame, (k, 1, 3, 3). `env_ids` are the
        indices of the k robots.
        """
        dt = self._dt
        jacobian_change = jacobians - self.contact.jacobians[env_ids]
        decay = np.exp(-self.contact.stance_time[env_ids] / PARAMETERS.touchdown_noise_decay)
        touchdown_std = (PARAMETERS.touchdown_velocity_std * decay)[..., None, None]
        encoder_variance = (PARAMETERS.encoder_offset_noise_gain * self._errors.zero) ** 2
        encoder_covariance = encoder_variance * (jacobian_change @ jacobian_change.mT)
        vertical_variance = (dt * touchdown_std) ** 2 + (PARAMETERS.ground_compliance * force_change) ** 2
        rest_covariance = (dt * PARAMETERS.contact_velocity_std) ** 2 * IDENTITY
        out: Array = rest_covariance + vertical_variance * vertical + encoder_covariance
        return out

    def _encoder_noise(self, readings: AlignedReadings, jacobians: Array) -> Array:
        """Return the covariance of each measured foot position of k robots, base frame, (k, 4, 3, 3), m².

        The covariance follows from the noise of the encoder `readings`. `jacobians`, (k, 4, 3, 3), m/rad, are the foot
        Jacobians, which convert joint angle errors to position errors.
        """
        angle_std = np.where(readings.has_new_angles, self._errors.angle, PARAMETERS.missing_sample_std)
        angle_std = angle_std[:, None, None, None]
        return angle_std * angle_std * (jacobians @ jacobians.mT)

    def _update_contact(
        self, readings: AlignedReadings, innovation: Array, expected: Array, jacobians: Array, env_ids: EnvIndices
    ) -> FootContactState:
        """Update and store the estimated contact of each foot of the k robots `env_ids`, and return it.

        `innovation` is the measured minus the predicted foot position, base frame, (k, 4, 3), m. `expected` is the
        covariance of the innovation for a foot in contact, (k, 4, 3, 3), m². `jacobians` are the foot Jacobians,
        (k, 4, 3, 3), m/rad.
        """
        previous = _select(self.contact, env_ids)
        probability = contact_probability(previous.probability, readings.contact, innovation, expected, self._dt)
        stance_time = probability * (previous.stance_time + self._dt)
        reading_time = readings.contact * (previous.reading_time + self._dt)
        contact = FootContactState(probability, stance_time, reading_time, jacobians)
        _assign(self.contact, env_ids, contact)
        return contact

    def _inflate_velocity(self, covariance: Array, contact: FootContactState, innovation: Array) -> Array:
        """Return the state covariance with a larger velocity variance if feet read contact but seem to move.

        `covariance` is the covariance of the errors of k states, (k, 24, 24), and `contact` the estimated contact of
        each foot. `innovation` is the measured minus the predicted foot position, base frame, (k, 4, 3), m.
        """
        has_long_reading = contact.reading_time > PARAMETERS.min_contact_duration
        slip_weight = np.where(has_long_reading, 1.0 - contact.probability, 0.0)
        squared_slip = (slip_weight * (innovation * innovation).sum(axis=-1)).sum(axis=-1)
        gain = (PARAMETERS.slip_velocity_inflation / self._dt) ** 2
        out = self._workspace.transition[: len(covariance)]
        np.copyto(out, covariance)
        out[:, VELOCITY, VELOCITY] += gain * squared_slip[:, None, None] * IDENTITY
        return out


def _swing_covariance(probability: Array, innovation: Array, expected: Array, vertical: Array, dt: float) -> Array:
    """Return the extra position covariance of feet that may be in swing, base frame, (k, 4, 3, 3), m².

    `probability` is the contact probability of each foot of k robots, (k, 4). `innovation` is the measured minus the
    predicted foot position, (k, 4, 3), m. `expected`, (k, 4, 3, 3), m², is the covariance of the innovation for a foot
    in contact. `vertical` is the projection matrix onto the vertical, (k, 1, 3, 3). All vectors and matrices are in the
    base frame. `dt` is the control period, s.
    """
    horizontal_variance = _swing_variance(PARAMETERS.swing_horizontal_velocity_std, probability, dt)
    vertical_variance = _swing_variance(CONTACT_PARAMETERS.swing_speed, probability, dt)
    excess = (innovation * innovation).sum(axis=-1) - (expected * IDENTITY).sum(axis=(-2, -1))
    slip_variance = PARAMETERS.slip_innovation_gain / 3 * probability * np.maximum(excess, 0.0)
    isotropic = (horizontal_variance + slip_variance)[..., None, None] * IDENTITY
    out: Array = isotropic + (vertical_variance - horizontal_variance)[..., None, None] * vertical
    return out


def _swing_variance(speed_std: float, probability: Array, dt: float) -> Array:
    """Return the extra variance of the position of a foot that may swing, along one axis, (k, 4), m².

    The variance rises from 0 at contact probability 1 to about (speed_std · dt)² at probability 0. `probability` is the
    contact probability of each foot of k robots, (k, 4). `speed_std` is the standard deviation of a swing foot's speed
    along the axis, m/s. `dt` is the control period, s.
    """
    rest_std = PARAMETERS.contact_velocity_std
    out: Array = (rest_std * dt) ** 2 * ((speed_std / rest_std) ** (2 - 2 * probability) - 1)
    return out


def _foot_blocks(matrices: Array) -> Array:
    """Return a view of the 3x3 blocks on the diagonals of k square `matrices`, (k, legs, 3, 3).

    The matrices have three rows and columns for each foot, (k, 3 legs, 3 legs).
    """
    legs = matrices.shape[-1] // 3
    blocks: Array = np.einsum("kaiaj->kaij", matrices.reshape(-1, legs, 3, legs, 3))
    return blocks


def _squared_length(vectors: Array) -> Array:
    """Return the squared length of each of k `vectors`, (k, 3), as an array (k, 1, 1)."""
    out: Array = (vectors * vectors).sum(axis=-1)[:, None, None]
    return out


def _select(state: Rows, env_ids: EnvIndices) -> Rows:
    """Return a copy of `state` in which every array has only the rows of the robots `env_ids`."""
    return type(state)(*(values[env_ids] for values in state))


def _assign(state: Rows, env_ids: EnvIndices, rows: Rows) -> None:
    """Write the arrays in `rows` into `state`, to the rows of the robots `env_ids`, in place."""
    for target, values in zip(state, rows, strict=True):
        target[env_ids] = values
