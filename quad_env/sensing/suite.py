"""What sensors the robot carries and how good they are, as values in physical units.

A sensor is sampled at control steps, `rate` times a second from the start of the episode, and holds each sample until
the next. A sample is seen `delay` after it was taken, at the first control step that is not earlier. Offsets are
errors: whatever reads the sensors knows nothing of them.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

from quad_env.config import Bounds, Finite, NonNegative, Positive, Settings
from quad_env.scenarios.disturbances import Delay


@dataclass(frozen=True)
class Sampled(Settings):
    """What every sensor has."""

    rate: Positive | None = None
    """Samples a second; the control rate is a whole multiple of it. None: one a control step"""
    delay: Delay = 0.01
    """s; one control step by default: what is measured in a step is acted on in the next"""


@dataclass(frozen=True)
class Imu(Sampled):
    """Gyroscope and accelerometer on the trunk, which share clock and mounting.

    The ranges are those of a MEMS device for robots (Bosch BMI088: ±2000 °/s, ±24 g). Noise is what densities of
    0.014 °/s/√Hz and 175 µg/√Hz leave in a band of 50 Hz, half a rate of 100 Hz; biases are of the size that such
    devices have after a moment of standing still (gyroscope) and as soldered, 20 mg (accelerometer).
    """

    gyro_bias: NonNegative = 0.003
    """rad/s, standard deviation over episodes of each axis' bias, which is constant within one"""
    gyro_noise: NonNegative = 0.0017
    """rad/s, standard deviation of the white noise on each axis of each sample"""
    gyro_range: Positive = 34.9
    """rad/s; readings saturate at ± this"""
    accelerometer_bias: NonNegative = 0.2
    """m/s²"""
    accelerometer_noise: NonNegative = 0.012
    """m/s²"""
    accelerometer_range: Positive = 235.0
    """m/s²"""
    position: tuple[Finite, Finite, Finite] = (0.01, 0.01, 0.01)
    """m, base frame: from the trunk's centre, where it is taken to be, to where it is. It reads the specific force
    there: α × r + ω × (ω × r) more than at the centre."""
    rotation: tuple[Finite, Finite, Finite] = (0.005, 0.005, 0.005)
    """rad, roll, pitch and yaw, turned in the order yaw, pitch, roll: from the base frame, which its axes are taken to
    be, to its axes. 0.3° is a careful assembly."""


@dataclass(frozen=True)
class Encoders(Sampled):
    """Absolute angle encoders on the joints; speed is the difference of two samples by their distance in time.

    Magnetic encoders have 12 to 16 bits and transition noise about 0.06° (ams AS5046, 12 bits; AS5048, 14 bits).
    """

    bits: Annotated[int, Bounds("from 1 to 32", 1, 32)] | None = 14
    """Steps of 2π/2^bits rad; None is as fine as numbers are"""
    noise: NonNegative = 0.001
    """rad, standard deviation of the white noise on each sample, before it is rounded to a step"""
    zero_offset: NonNegative = 0.005
    """rad, standard deviation over episodes and joints of where zero is, constant within an episode; 0.3° is
    a robot whose joints were zeroed in a jig"""

    @property
    def step(self) -> float:
        """rad; 0 where there are none."""
        return 0.0 if self.bits is None else 2 * math.pi / 2**self.bits


@dataclass(frozen=True)
class FootContact(Sampled):
    """Force sensors in the feet, read as contact or none; each foot carries 35 N when the robot stands on four."""

    threshold: Positive = 10.0
    """N from which a foot counts as standing"""
    noise: NonNegative = 1.0
    """N, standard deviation of the white noise on each sample"""


@dataclass(frozen=True)
class JointTorque(Sampled):
    """Torque of each joint's drive; the defaults are one per cent of SimpleQuad's range."""

    bias: NonNegative = 1.0
    """N·m, standard deviation over episodes and joints, constant within an episode"""
    noise: NonNegative = 1.0
    """N·m, standard deviation of the white noise on each sample"""
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
    Imu(None, 0.0, 0.0, 0.0, 1e3, 0.0, 0.0, 1e5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    Encoders(None, 0.0, None, 0.0, 0.0),
    FootContact(None, 0.0, noise=0.0),
    JointTorque(None, 0.0, 0.0, 0.0, 1e4),
)
"""No noise, bias, offset or delay: what is left is the error of estimating."""
TRUTH = "truth"
SENSORS = {"ideal": IDEAL, "typical": SensorSuite()}


def sensor_suite(which: str | SensorSuite | None) -> SensorSuite | None:
    """The suite of that name, or the suite itself, or None for the truth; ValueError lists the valid names."""
    if which is None or isinstance(which, SensorSuite):
        return which
    if which == TRUTH:
        return None
    if not isinstance(which, str) or which not in SENSORS:
        raise ValueError(f"unknown sensors {which!r}; valid: {', '.join((TRUTH, *SENSORS))}, or a quad_env.SensorSuite")
    return SENSORS[which]
