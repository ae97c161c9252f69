"""Sensors of a robot and their errors, as values in physical units.

A sensor is sampled at control steps, `rate` times a second from the start of the episode, and holds each sample until
the next. A sample is visible `delay` after it was taken, at the first control step from then on. Offsets are errors:
readers of the sensors do not know them.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

from quad_env.config import Bounds, Finite, NonNegative, Positive, Settings
from quad_env.scenarios.disturbances import Delay


@dataclass(frozen=True)
class Sampled(Settings):
    """Sample rate and delay, the base of every sensor."""

    rate: Positive | None = None
    """Samples a second; the control rate is an integer multiple of it. None: the control rate"""
    delay: Delay = 0.01
    """s; one control step by default: a measurement of one step is used in the next"""


@dataclass(frozen=True)
class Imu(Sampled):
    """Gyroscope and accelerometer on the trunk, which share clock and mounting.

    The ranges are from a MEMS device for robots (Bosch BMI088: ±2000 °/s, ±24 g). The noise follows from densities
    of 0.014 °/s/√Hz and 175 µg/√Hz in a band of 50 Hz, half a rate of 100 Hz. The gyroscope's bias is typical of a
    MEMS device after a moment at rest, the accelerometer's of one as soldered (20 mg).
    """

    gyro_bias: NonNegative = 0.003
    """rad/s; standard deviation over episodes of each axis' bias, which is constant in an episode"""
    gyro_noise: NonNegative = 0.0017
    """rad/s; standard deviation of the white noise on each axis of each sample"""
    gyro_range: Positive = 34.9
    """rad/s; readings saturate at ± this"""
    accelerometer_bias: NonNegative = 0.2
    """m/s²; as `gyro_bias`"""
    accelerometer_noise: NonNegative = 0.012
    """m/s²; as `gyro_noise`"""
    accelerometer_range: Positive = 235.0
    """m/s²; as `gyro_range`"""
    position: tuple[Finite, Finite, Finite] = (0.01, 0.01, 0.01)
    """m, base frame; error of the position: from the trunk's centre, its assumed position, to the true one. The sensor
    reads the specific force there: α × r + ω × (ω × r) more than at the centre."""
    rotation: tuple[Finite, Finite, Finite] = (0.005, 0.005, 0.005)
    """rad; error of the mounting: roll, pitch and yaw, in the order yaw, pitch, roll, from the base frame, its assumed
    axes, to the true axes. 0.3° is a careful assembly."""


@dataclass(frozen=True)
class Encoders(Sampled):
    """Absolute angle encoders on the joints; joint velocity is the difference of two samples over their time.

    Magnetic encoders have 12 to 16 bits and transition noise about 0.06° (ams AS5046, 12 bits; AS5048, 14 bits).
    """

    bits: Annotated[int, Bounds("from 1 to 32", 1, 32)] | None = 14
    """Resolution: steps of 2π/2^bits rad; None for floating-point resolution"""
    noise: NonNegative = 0.001
    """rad; standard deviation of the white noise on each sample, before it is rounded to a step"""
    zero_offset: NonNegative = 0.005
    """rad; standard deviation of the zero offset over episodes and joints, constant in an episode. 0.3° is a robot
    with joints zeroed in a jig"""

    @property
    def step(self) -> float:
        """Resolution, rad; 0 without a finite one."""
        return 0.0 if self.bits is None else 2 * math.pi / 2**self.bits


@dataclass(frozen=True)
class FootContact(Sampled):
    """Force sensors in the feet, read as contact or none; each foot carries 35 N of a robot that stands on four."""

    threshold: Positive = 10.0
    """N; minimum force that reads as contact"""
    noise: NonNegative = 1.0
    """N; standard deviation of the white noise on each sample"""


@dataclass(frozen=True)
class JointTorque(Sampled):
    """Torque sensors of the joints' drives; the defaults are one per cent of SimpleQuad's range."""

    bias: NonNegative = 1.0
    """N·m; standard deviation over episodes and joints, constant in an episode"""
    noise: NonNegative = 1.0
    """N·m; standard deviation of the white noise on each sample"""
    range: Positive | None = None
    """N·m; readings saturate at ± this; None: the robot's rated torque"""


@dataclass(frozen=True)
class SensorSuite(Settings):
    """All sensors of a robot."""

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
"""Sensors without noise, bias, offset or delay: only the estimation error is left."""
TRUTH = "truth"
SENSORS = {"ideal": IDEAL, "typical": SensorSuite()}


def sensor_suite(name: str | SensorSuite | None) -> SensorSuite | None:
    """Return the suite of a name.

    Args:
        name: One of `SENSORS`, `TRUTH`, a suite, or None for the true state.

    Returns:
        The suite; None for the true state.

    Raises:
        ValueError: The name is unknown; the message lists the valid ones.
    """
    if name is None or isinstance(name, SensorSuite):
        return name
    if name == TRUTH:
        return None
    if not isinstance(name, str) or name not in SENSORS:
        raise ValueError(f"unknown sensors {name!r}; valid: {', '.join((TRUTH, *SENSORS))}, or a quad_env.SensorSuite")
    return SENSORS[name]
