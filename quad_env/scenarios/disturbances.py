"""Disturbances of an episode as values in physical units; a `Scenario` combines any of them."""

import math
from dataclasses import dataclass
from typing import Annotated

from quad_env.config import Bounds, NonNegative, Positive, Settings
from quad_env.robots.robot import Robot

Delay = Annotated[float, Bounds("from 0 s to 10 s", 0.0, 10.0)]
"""A delay, s."""


def _check_window(events: str, count: int, duration: float, window: tuple[float, float]) -> None:
    """Raise ValueError for events that do not fit into their window."""
    start, end = window
    if not (0 <= start < end < math.inf and duration > 0 and count >= 0 and count * duration <= end - start):
        raise ValueError(f"{count} {events} of {duration} s do not fit into the window {window} s")


@dataclass(frozen=True)
class Pushes(Settings):
    """Horizontal force pulses on the trunk's centre, at random times, in random world directions.

    The window is cut into `count` equal parts with one push in each, so that pushes never overlap.
    """

    count: int = 2
    impulse: NonNegative = 35.0
    """N·s of each push"""
    duration: float = 0.1
    """s of each push"""
    window: tuple[float, float] = (1.0, 9.0)
    """s since the start of the episode; every push lies in this window"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("pushes", self.count, self.duration, self.window)


@dataclass(frozen=True)
class SteadyForce(Settings):
    """Constant horizontal force on the trunk's centre in a random world direction, for example wind or a tether."""

    force: NonNegative = 20.0
    """N"""


@dataclass(frozen=True)
class Ground(Settings):
    """Contact properties of the ground.

    Contacts have the friction and softness of the ground, not of the touching body: the ground's contact priority is
    higher.

    A soft ground is a linear spring and a damper under each contact point. MuJoCo pushes a foot out of the ground with
    the force K s, where s is the depth and K = 1/((1 - d) T² Â). T is the time constant `solref[0]`, d = 0.95 the
    largest impedance `solimp[1]`, and Â the inverse inertia of a free leg's end, `body_invweight0`. A foot that carries
    a quarter of the robot's weight thus sinks by `sink_depth` with T² = sink_depth / ((1 - d) Â m g / 4). It is
    overdamped. A foot under side load creeps. Shins pass through soft ground; feet, knees and the trunk are supported.
    """

    friction: Positive = 0.8
    """Friction coefficient of every contact with the ground; 0.8 is rubber on concrete."""
    sink_depth: float = 0.0
    """m; depth of the feet of a robot that stands in its home pose without a load; 0 is hard ground (0.3 mm), and
    values between 0 and 1 mm are invalid"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sink_depth != 0 and not 0.001 <= self.sink_depth < 100:
            raise ValueError(f"sink_depth must be 0 or 0.001 m to 100 m, got {self.sink_depth}")


@dataclass(frozen=True)
class Motors(Settings):
    """Limits of the joint servos."""

    torque_limit: Positive | None = None
    """N·m; None for the robot's rated torque"""
    bandwidth: Positive | None = None
    """Hz; corner frequency of a first-order low-pass filter of the joint targets, with the time constant
    1/(2π·bandwidth). None for no filter."""

    def max_torque(self, robot: Robot) -> float:
        """Return the torque limit on `robot`, N·m."""
        return robot.rated_torque if self.torque_limit is None else self.torque_limit

    def largest_torque(self, robot: Robot) -> float:
        """Call `max_torque(robot)`. Deprecated name."""
        return self.max_torque(robot)


@dataclass(frozen=True)
class Payload(Settings):
    """Cube welded to the top of the trunk, with its centre drawn uniformly within `reach` at reset."""

    mass: Positive = 5.0
    """kg"""
    reach: tuple[NonNegative, NonNegative] = (0.2, 0.1)
    """m; half-widths of the position: forward and to the left of the trunk's centre"""
    edge: Positive = 0.2
    """m; edge of the cube, which has uniform density"""


@dataclass(frozen=True)
class Latency(Settings):
    """Constant delays, each rounded to control steps."""

    action: Delay = 0.02
    """s from the policy to the servos, which hold the home pose until the first action arrives; `previous_action` is
    the policy's last output, not the last action that arrived"""
    observation: Delay = 0.02
    """s from the sensors to the policy, which sees the first reading until the next one arrives. Applies to the sensed
    terms; `previous_action` and `command` have no delay."""


@dataclass(frozen=True)
class SensorNoise(Settings):
    """White Gaussian noise on the sensed terms of the observation, drawn at every control step.

    The proportions between the terms follow legged_gym's `LeggedRobotCfg.noise.noise_scales` (Rudin et al., 2022:
    angular velocity 0.2 rad/s, linear velocity 0.1 m/s, gravity 0.05, joint position 0.01 rad, joint velocity
    1.5 rad/s). There they are half-widths of uniform noise, here standard deviations.
    """

    gyro: NonNegative = 0.2
    """rad/s; standard deviation of each component of `angular_velocity`; the other terms are in proportion"""

    @property
    def height_scan(self) -> float:
        """Standard deviation of each point of a height scan, m; legged_gym has 0.1 m too."""
        return 0.5 * self.gyro

    @property
    def deviations(self) -> dict[str, float]:
        """Name of each sensed term in `quad_env.OBSERVATION` -> its standard deviation, in its unit."""
        return {
            "projected_gravity": 0.25 * self.gyro,
            "angular_velocity": self.gyro,
            "linear_velocity": 0.5 * self.gyro,
            "joint_position": 0.05 * self.gyro,
            "joint_velocity": 7.5 * self.gyro,
        }


@dataclass(frozen=True)
class Dropouts(Settings):
    """Times in which one joint's servo receives no targets and holds its last one.

    The window is cut into `count` equal parts with one dropout in each, at a random time, of a random joint.
    """

    count: int = 4
    duration: float = 0.3
    """s of each dropout"""
    window: tuple[float, float] = (1.0, 9.0)
    """s since the start of the episode; every dropout lies in this window"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("dropouts", self.count, self.duration, self.window)
