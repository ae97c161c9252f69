"""What an episode can be disturbed by, as values in physical units; a `Scenario` holds any of them together."""

import math
from dataclasses import dataclass
from typing import Annotated

from quad_env.config import Bounds, NonNegative, Positive, Settings
from quad_env.robots.robot import Robot

Delay = Annotated[float, Bounds("from 0 s to 10 s", 0.0, 10.0)]


def _check_window(what: str, count: int, duration: float, window: tuple[float, float]) -> None:
    start, end = window
    if not (0 <= start < end < math.inf and duration > 0 and count >= 0 and count * duration <= end - start):
        raise ValueError(f"{count} {what} of {duration} s do not fit into the window {window} s")


@dataclass(frozen=True)
class Pushes(Settings):
    """Horizontal forces on the trunk's centre, at random times, in random world directions.

    The window is cut into `count` equal parts with one push in each, so that pushes never overlap.
    """

    count: int = 2
    impulse: NonNegative = 35.0
    """N·s each"""
    duration: float = 0.1
    """s"""
    window: tuple[float, float] = (1.0, 9.0)
    """s from the start of the episode within which every push lies"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("pushes", self.count, self.duration, self.window)


@dataclass(frozen=True)
class SteadyForce(Settings):
    """A horizontal force on the trunk's centre in a random world direction, from the start of the episode to its end:
    wind, or a tether."""

    force: NonNegative = 20.0
    """N"""


@dataclass(frozen=True)
class Ground(Settings):
    """What the ground is made of.

    Whatever touches it has the ground's friction and softness, not its own: the ground's contact priority is higher.

    A soft ground is a linear spring and a damper under each point of contact. MuJoCo presses a foot out of the ground
    with the force K s, where s is the depth, K = 1/((1 - d) T² Â), T the time constant `solref[0]`, d = 0.95 the
    largest impedance `solimp[1]` and Â the inverse inertia of a free leg's end, `body_invweight0`. A foot that carries
    a quarter of the robot's weight thus sinks by `sink_depth` with T² = sink_depth / ((1 - d) Â m g / 4). It is damped
    more than critically. A foot under side load creeps. Shins cut through soft ground; it carries feet, knees, trunk.
    """

    friction: Positive = 0.8
    """Coefficient between the ground and whatever touches it; 0.8 is rubber on concrete."""
    sink_depth: float = 0.0
    """m that the feet of the standing robot sink, in its home pose without a load; 0 is the hard ground (0.3 mm), and
    below a millimetre there is nothing else"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sink_depth != 0 and not 0.001 <= self.sink_depth < 100:
            raise ValueError(f"sink_depth must be 0 or 0.001 m to 100 m, got {self.sink_depth}")


@dataclass(frozen=True)
class Motors(Settings):
    """What the joint servos can do."""

    torque_limit: Positive | None = None
    """N·m; None: the robot's rated torque"""
    bandwidth: Positive | None = None
    """Hz at which a servo follows a sine of its target with 1/√2 of the amplitude: a first-order filter of the target
    with the time constant 1/(2π·bandwidth). None is a servo that sees its target at once."""

    def max_torque(self, robot: Robot) -> float:
        """Torque limit on that robot, N·m."""
        return robot.rated_torque if self.torque_limit is None else self.torque_limit


@dataclass(frozen=True)
class Payload(Settings):
    """A cube welded to the top of the trunk, its centre at a place drawn uniformly over `reach` at reset."""

    mass: Positive = 5.0
    """kg"""
    reach: tuple[NonNegative, NonNegative] = (0.2, 0.1)
    """m, half-widths: forward and to the left of the trunk's centre"""
    edge: Positive = 0.2
    """m, of the cube; its density is uniform"""


@dataclass(frozen=True)
class Latency(Settings):
    """Delays of constant length; each is rounded to whole control steps."""

    action: Delay = 0.02
    """s from the policy to the servos, which hold the home pose until the first action arrives; `previous_action` shows
    what the policy asked for, not what has arrived"""
    observation: Delay = 0.02
    """s from the sensors to the policy; until the first reading arrives it sees that of the start. Applies to the
    sensed terms: `previous_action` and `command` are never late."""


@dataclass(frozen=True)
class SensorNoise(Settings):
    """White Gaussian noise on the sensed terms of the observation, new at every control step.

    The proportions between the terms are those of legged_gym's `LeggedRobotCfg.noise.noise_scales` (Rudin et al., 2022:
    angular velocity 0.2 rad/s, linear velocity 0.1 m/s, gravity 0.05, joint position 0.01 rad, joint velocity
    1.5 rad/s); there they are half-widths of uniform noise, here standard deviations.
    """

    gyro: NonNegative = 0.2
    """rad/s, standard deviation of each component of `angular_velocity`; every other term's is in proportion"""

    @property
    def height_scan(self) -> float:
        """m, standard deviation of each point of a height scan, where there is one: legged_gym has 0.1 m too."""
        return 0.5 * self.gyro

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each sensed term, by its name in `quad_env.OBSERVATION`, in that term's unit."""
        return {
            "projected_gravity": 0.25 * self.gyro,
            "angular_velocity": self.gyro,
            "linear_velocity": 0.5 * self.gyro,
            "joint_position": 0.05 * self.gyro,
            "joint_velocity": 7.5 * self.gyro,
        }


@dataclass(frozen=True)
class Dropouts(Settings):
    """Moments in which one joint's servo receives no targets and holds its last target.

    The window is cut into `count` equal parts with one dropout in each, at a random time, of a random joint.
    """

    count: int = 4
    duration: float = 0.3
    """s"""
    window: tuple[float, float] = (1.0, 9.0)
    """s from the start of the episode within which every dropout lies"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("dropouts", self.count, self.duration, self.window)
