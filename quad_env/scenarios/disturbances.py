"""Settings of the disturbances of an episode, such as pushes or latency; a `Scenario` combines them."""

import math
from dataclasses import dataclass
from typing import Annotated

from quad_env.config import Bounds, Fraction, NonNegative, Positive, Settings
from quad_env.robots.robot import Robot

Delay = Annotated[float, Bounds("from 0 s to 10 s", 0.0, 10.0)]
"""Type of a setting that is a delay, from 0 to 10 s."""


def _check_window(events: str, count: int, duration: float, window: tuple[float, float]) -> None:
    """Raise ValueError if `count` events of a `duration`, s, do not fit into a time `window`.

    `window` is the start and the end of the time window, s since the start of the episode. `events` is the name of the
    events in the error message, for example `pushes`.
    """
    start, end = window
    if not (0 <= start < end < math.inf and duration > 0 and count >= 0 and count * duration <= end - start):
        raise ValueError(f"{count} {events} of {duration} s do not fit into the window {window} s")


@dataclass(frozen=True)
class Pushes(Settings):
    """Horizontal force pulses on the trunk's centre, at random times, in random world directions.

    The time window is divided into `count` equal parts. Each part contains one push, so that pushes never overlap.
    """

    count: int = 2
    impulse: NonNegative = 35.0
    """Impulse of each push, N·s"""
    duration: float = 0.1
    """Duration of each push, s"""
    window: tuple[float, float] = (1.0, 9.0)
    """Start and end of the time window that contains every push, s since the start of the episode"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("pushes", self.count, self.duration, self.window)


@dataclass(frozen=True)
class Kicks(Settings):
    """Short horizontal forces of random strength on the trunk's centre, throughout an episode.

    Training uses kicks, so that every robot of a batch experiences weak and strong pushes. Duration, time and direction
    of each kick are random, too.
    """

    speed: NonNegative = 1.0
    """Largest velocity change of the robot by a kick, m/s; each change is drawn uniformly from 0 to this value"""
    duration: tuple[Positive, Positive] = (0.05, 0.2)
    """Shortest and longest duration of a kick, s"""
    interval: tuple[Positive, Positive] = (1.0, 3.0)
    """Shortest and longest time from the start of a kick to the start of the next kick, s"""
    count: int = 10
    """Number of kicks in an episode; the first kick begins one interval after the start of the episode"""


@dataclass(frozen=True)
class SteadyForce(Settings):
    """Constant horizontal force on the trunk's centre in a random direction, for example wind."""

    force: NonNegative = 20.0
    """Magnitude of the force, N"""


@dataclass(frozen=True)
class Ground(Settings):
    """Contact properties of the ground: friction and softness.

    Every contact has the friction and softness of the ground, because the ground has a higher contact priority than the
    bodies that touch it.

    A soft ground is a linear spring and a damper under each contact point. MuJoCo pushes a foot out of the ground with
    the force K s, where s is the depth of the foot in the ground. The stiffness is K = 1/((1 - d) T² Â). T is the time
    constant `solref[0]` of the contact, s. d = 0.95 is the largest constraint impedance `solimp[1]`. Â is the inverse
    mass at the end of a free leg, MuJoCo's `body_invweight0`, 1/kg. T follows from the condition that a foot that
    carries a quarter of the robot's weight m g sinks by `sink_depth`: T² = sink_depth / ((1 - d) Â m g / 4).

    The spring is overdamped. A foot under a constant side load creeps. Soft ground supports feet, knees and the trunk,
    but not the shins.
    """

    friction: Positive = 0.8
    """Coulomb friction coefficient of every contact with the ground; 0.8 is the value of rubber on concrete."""
    sink_depth: float = 0.0
    """Depth to which the feet of a robot without a load sink into the ground in the home pose, m.

    The value 0 means hard ground, into which feet sink by 0.3 mm. Values between 0 and 1 mm are invalid.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sink_depth != 0 and not 0.001 <= self.sink_depth < 100:
            raise ValueError(f"sink_depth must be 0 or 0.001 m to 100 m, got {self.sink_depth}")


@dataclass(frozen=True)
class Motors(Settings):
    """Scenario's limits on torque and bandwidth of the joint servos."""

    torque_limit: Positive | None = None
    """Torque limit of each joint servo, N·m; None for the robot's rated torque"""
    bandwidth: Positive | None = None
    """Corner frequency of a first-order low-pass filter of the joint targets, Hz; None for no filter.

    The time constant of the filter is 1/(2π·bandwidth), s.
    """

    def max_torque(self, robot: Robot) -> float:
        """Return the torque limit of the servos of `robot`, N·m: `torque_limit`, or the robot's rated torque."""
        return robot.rated_torque if self.torque_limit is None else self.torque_limit

    def largest_torque(self, robot: Robot) -> float:
        """Return `max_torque(robot)`; deprecated name of `max_torque`."""
        return self.max_torque(robot)


@dataclass(frozen=True)
class Payload(Settings):
    """Load of the robot: a cube that is welded to the top of the trunk at a random horizontal position.

    The position is drawn uniformly within `reach` at every reset.
    """

    mass: Positive = 5.0
    """Mass of the cube, kg"""
    reach: tuple[NonNegative, NonNegative] = (0.2, 0.1)
    """Largest horizontal distances of the cube from the trunk's centre: along the trunk, and to either side, m"""
    edge: Positive = 0.2
    """Edge length of the cube, which has uniform density, m"""

    @property
    def moment_of_inertia(self) -> float:
        """Moment of inertia of the cube about each axis through its centre, kg·m²."""
        return self.mass * self.edge**2 / 6


@dataclass(frozen=True)
class Latency(Settings):
    """Constant delays of actions (joint targets) and observations; each is rounded to whole control steps."""

    action: Delay = 0.02
    """Delay from the policy to the servos, s.

    The servos hold the home pose until the first action arrives. The observation term `previous_action` contains the
    last action of the policy, even if this action has not arrived at the servos.
    """
    observation: Delay = 0.02
    """Delay from the sensors to the policy, s.

    At the start of an episode, the policy observes the first measurement until the second measurement arrives. Only
    observation terms that sensors measure are delayed; the terms `previous_action` and `command` are not.
    """

    def observation_steps(self, dt: float) -> int:
        """Return the delay of the observations, rounded to whole control steps.

        Args:
            dt: Control period, s.

        Returns:
            Number of control steps.
        """
        return round(self.observation / dt)


@dataclass(frozen=True)
class SensorNoise(Settings):
    """White Gaussian noise on the observation terms that sensors measure, drawn at every control step.

    The proportions between the terms follow legged_gym's `LeggedRobotCfg.noise.noise_scales` (Rudin et al., 2022:
    angular velocity 0.2 rad/s, linear velocity 0.1 m/s, gravity 0.05, joint position 0.01 rad, joint velocity
    1.5 rad/s). In legged_gym the values are half-widths of uniform noise; here they are standard deviations.
    """

    gyro: NonNegative = 0.2
    """Standard deviation of each component of `angular_velocity`, rad/s.

    The noise of the other observation terms is in proportion to this value.
    """

    @property
    def height_scan(self) -> float:
        """Standard deviation of the noise on each point of a height scan, m.

        The noise is in proportion to the gyro's noise, `gyro`. With the default `gyro`, the standard deviation is
        0.1 m, as in legged_gym.
        """
        return 0.5 * self.gyro

    @property
    def deviations(self) -> dict[str, float]:
        """Name of an observation term -> standard deviation of its noise, in the unit of the term."""
        return {
            "projected_gravity": 0.25 * self.gyro,
            "angular_velocity": self.gyro,
            "linear_velocity": 0.5 * self.gyro,
            "joint_position": 0.05 * self.gyro,
            "joint_velocity": 7.5 * self.gyro,
        }


@dataclass(frozen=True)
class Dropouts(Settings):
    """Dropouts: periods in which one joint servo receives no new targets, and so holds its last target.

    The time window is divided into `count` equal parts. Each part contains one dropout of a random joint, at a random
    time. Therefore two dropouts never overlap.
    """

    count: int = 4
    duration: float = 0.3
    """Duration of each dropout, s"""
    window: tuple[float, float] = (1.0, 9.0)
    """Start and end of the time window that contains every dropout, s since the start of the episode"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("dropouts", self.count, self.duration, self.window)


@dataclass(frozen=True)
class ScanDropouts(Settings):
    """Dropouts of the height scan: periods in which all points of the grid, or a half of them, show no ground.

    The time window is divided into `count` equal parts. Each part contains one dropout at a random time. A dropout
    hides all points, or with the same probability only those on one side of the trunk's centre, in a random direction.
    """

    count: int = 3
    duration: float = 1.5
    """Duration of each dropout, s"""
    window: tuple[float, float] = (0.0, 9.0)
    """Start and end of the time window that contains every dropout, s since the start of the episode"""
    lost_fraction: Fraction = 0.25
    """Probability that the scan shows no ground in the whole episode, 0 to 1"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_window("scan_dropouts", self.count, self.duration, self.window)
