"""Settings of the sensors of a robot and of their errors, in physical units.

A sensor takes samples at control steps, `rate` times a second from the start of the episode. The sensor holds each
sample until the next sample. Policy and estimator can read a sample from the first control step that is at least
`delay` after the measurement. Biases and offsets are errors: the estimator and the policy do not know them.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

from quad_env.config import Bounds, Finite, NonNegative, Positive, Settings
from quad_env.scenarios.disturbances import Delay


@dataclass(frozen=True)
class Sampled(Settings):
    """Base class of the settings of a sensor: sample rate and delay."""

    rate: Positive | None = None
    """Sample rate, Hz; None for the control rate, which must be an integer multiple of the sample rate"""
    delay: Delay = 0.01
    """Time from a measurement until it can be read, s; by default one control step"""


@dataclass(frozen=True)
class Imu(Sampled):
    """Settings of the IMU: gyroscope and accelerometer on the trunk, with one clock and one mounting.

    The ranges are from a MEMS device for robots (Bosch BMI088: ±2000 °/s, ±24 g). The noise follows from densities
    of 0.014 °/s/√Hz and 175 µg/√Hz in a band of 50 Hz, half of a rate of 100 Hz. The gyroscope bias is typical of a
    MEMS device that was calibrated while the robot stood still for a moment. The accelerometer bias (20 mg) is typical
    of a soldered device that was not calibrated.
    """

    gyro_bias: NonNegative = 0.003
    """Standard deviation of each axis's gyroscope bias over episodes, rad/s; constant during an episode"""
    gyro_noise: NonNegative = 0.0017
    """Standard deviation of the white noise on each axis of each gyroscope sample, rad/s"""
    gyro_range: Positive = 34.9
    """Magnitude at which gyroscope readings saturate, rad/s"""
    accelerometer_bias: NonNegative = 0.2
    """Standard deviation of each axis's accelerometer bias over episodes, m/s²; constant during an episode"""
    accelerometer_noise: NonNegative = 0.012
    """Standard deviation of the white noise on each axis of each accelerometer sample, m/s²"""
    accelerometer_range: Positive = 235.0
    """Magnitude at which accelerometer readings saturate, m/s²"""
    position: tuple[Finite, Finite, Finite] = (0.01, 0.01, 0.01)
    """Position error r of the IMU: true position relative to the trunk's centre, base frame, m.

    The estimator assumes that the IMU is at the trunk's centre. The accelerometer reads α × r + ω × (ω × r) more than
    at the centre. α is the angular acceleration, and ω the angular velocity of the trunk.
    """
    rotation: tuple[Finite, Finite, Finite] = (0.005, 0.005, 0.005)
    """Mounting error of the IMU: roll, pitch and yaw from the base frame to the true IMU axes, rad.

    The rotations are in the order yaw, pitch, roll. The estimator assumes that the IMU axes are the axes of the base
    frame. An error of 0.3° corresponds to a careful assembly.
    """


@dataclass(frozen=True)
class Encoders(Sampled):
    """Settings of the absolute angle encoders on the joints.

    Joint velocity is the difference of two samples divided by the sample period.

    Magnetic encoders have 12 to 16 bits and a transition noise of about 0.06° (ams AS5046, 12 bits; AS5048, 14 bits).
    """

    bits: Annotated[int, Bounds("from 1 to 32", 1, 32)] | None = 14
    """Resolution in bits: one encoder step is 2π/2^bits rad; None for floating-point resolution"""
    noise: NonNegative = 0.001
    """Standard deviation of the white noise on each angle sample before rounding to encoder steps, rad"""
    zero_offset: NonNegative = 0.005
    """Standard deviation of the encoders' zero offset over episodes and joints, rad; constant during an episode.

    An offset of 0.3° is typical of a robot with joints that were zeroed in a jig.
    """

    @property
    def step(self) -> float:
        """Smallest difference between two unequal encoder readings, 2π/2^bits rad; 0 if `bits` is None."""
        return 0.0 if self.bits is None else 2 * math.pi / 2**self.bits


@dataclass(frozen=True)
class FootContact(Sampled):
    """Settings of the foot contact sensors: they read contact if the measured force reaches a threshold.

    For comparison with `threshold`: each foot of SimpleQuad carries 35 N if the robot stands on four feet.
    """

    threshold: Positive = 10.0
    """Minimum force that reads as contact, N"""
    noise: NonNegative = 1.0
    """Standard deviation of the white noise on the force of each sample, N"""


@dataclass(frozen=True)
class JointTorque(Sampled):
    """Settings of the joint torque sensors; default bias and noise are 1 % of SimpleQuad's rated torque."""

    bias: NonNegative = 1.0
    """Standard deviation of the sensors' bias over episodes and joints, N·m; constant during an episode"""
    noise: NonNegative = 1.0
    """Standard deviation of the white noise on each torque sample, N·m"""
    range: Positive | None = None
    """Magnitude at which torque readings saturate, N·m; None for the robot's rated torque"""


@dataclass(frozen=True)
class SensorSuite(Settings):
    """Settings of all sensors of a robot: IMU, joint encoders, foot contact and joint torque."""

    imu: Imu = field(default_factory=Imu)
    encoders: Encoders = field(default_factory=Encoders)
    feet: FootContact = field(default_factory=FootContact)
    torque: JointTorque = field(default_factory=JointTorque)


IDEAL = SensorSuite(
    Imu(
        rate=None,
        delay=0.0,
        gyro_bias=0.0,
        gyro_noise=0.0,
        gyro_range=1e3,
        accelerometer_bias=0.0,
        accelerometer_noise=0.0,
        accelerometer_range=1e5,
        position=(0.0, 0.0, 0.0),
        rotation=(0.0, 0.0, 0.0),
    ),
    Encoders(rate=None, delay=0.0, bits=None, noise=0.0, zero_offset=0.0),
    FootContact(rate=None, delay=0.0, noise=0.0),
    JointTorque(rate=None, delay=0.0, bias=0.0, noise=0.0, range=1e4),
)
"""Ideal sensors, which have no noise, bias, offset or delay.

All errors of an observation then come from the state estimator.
"""
TRUTH = "truth"
SENSORS = {"ideal": IDEAL, "typical": SensorSuite()}


def sensor_suite(name: str | SensorSuite | None) -> SensorSuite | None:
    """Return the sensor suite named `name`.

    Args:
        name: A key of `SENSORS`, or a sensor suite, which is returned unchanged. "truth" or None to observe the true
            state.

    Returns:
        The sensor suite; None if the observation is the true state.

    Raises:
        ValueError: The name is unknown; the message lists the valid names.
    """
    if name is None or isinstance(name, SensorSuite):
        return name
    if name == TRUTH:
        return None
    if not isinstance(name, str) or name not in SENSORS:
        raise ValueError(f"unknown sensors {name!r}; valid: {', '.join((TRUTH, *SENSORS))}, or a quad_env.SensorSuite")
    return SENSORS[name]
