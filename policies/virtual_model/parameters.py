"""What the search of `trot_virtual` tunes: the gait, the virtual springs and dampers of the trunk, the footholds."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

from policies.mpc.parameters import MpcParameters
from policies.parameters import ParameterFile, Parameters, number, scaled_ranges, search_ranges_of
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIGH, LONG, WIDE
from quad_env.robots.simple_quad import SIMPLE_QUAD

FASTEST = 3.2
"""Most gait cycles a second of any robot, Hz."""


@dataclass(frozen=True)
class VirtualParameters(Parameters):
    """Gait and gains; those of the trunk are accelerations per error, as of a body on springs and dampers."""

    frequency: float = number(2.6, limits=(0.1, 50.0), search=(2.0, 3.1), unit="Hz")
    """Gait cycles a second, Hz."""
    duty: float = number(0.54, limits=(0.05, 0.95), search=(0.5, 0.65))
    """Share of the cycle that a foot is on the ground."""
    height: float = number(0.445, limits=(0.01, 5.0), search=(0.44, 0.54), unit=HIGH)
    """Hip joints above the centres of the standing feet, m; of SimpleQuad the trunk's centre too."""
    width: float = number(0.5, limits=(0.005, 10.0), search=(0.44, 0.6), unit=WIDE)
    """Between the lines of the left and the right feet, m."""
    length: float = number(0.5, limits=(0.005, 10.0), search=(0.42, 0.6), unit=LONG)
    """Between the lines of the fore and the hind feet, m."""
    shift: float = number(0.0, limits=(-2.0, 2.0), search=(-0.05, 0.05), unit="m ahead")
    """Middle of the feet ahead of the centre of mass, m."""
    step_height: float = number(0.05, limits=(0.0, 2.0), search=(0.035, 0.12), unit="m")
    """Lift of a swinging foot, m."""
    roughness_gain: float = number(4.0, limits=(0.0, 100.0), search=(0.0, 6.0))
    """Lift added per roughness of the ground, the distance of the footprints from their plane."""
    landing_depth: float = number(0.003, limits=(0.0, 1.0), search=(0.0, 0.01), unit="m")
    """How far below the ground the path of a swinging foot ends, m."""
    landing: float = number(0.8, limits=(0.1, 1.0), search=(0.65, 1.0))
    """Progress of a swing from which on the foot only comes down, over its foothold."""
    neutral_share: float = number(0.45, limits=(-1.0, 2.0), search=(0.3, 0.6))
    """Foothold ahead of the neutral one, as a share of the way that the body makes in a stance."""
    reach: float = number(0.22, limits=(0.01, 5.0), search=(0.15, 0.35), unit="m")
    """Farthest that a foothold is ahead of the neutral one, m."""
    step_gain: float = number(0.06, limits=(-1.0, 1.0), search=(0.0, 0.2), unit="s")
    """A foot is put further out by this times the velocity error, s; √(height / g) is the capture point's."""
    lean_gain: float = number(0.8, limits=(0.0, 10.0), search=(0.0, 1.5))
    """Shift of the footholds against a lasting force, as a share of what balances it."""
    acceleration: float = number(3.0, limits=(1e-3, 1e6), search=(2.0, 12.0), unit="m/s²")
    """Fastest change of the forward and of the lateral reference velocity, m/s²."""
    yaw_acceleration: float = number(20.0, limits=(1e-3, 1e6), search=(5.0, 60.0), unit="rad/s²")
    """Fastest change of the reference yaw rate, rad/s²."""
    position_gain: float = number(1.0, limits=(0.0, 100.0), search=(0.0, 2.0), unit="1/s")
    """Velocity added to the command per distance, and yaw rate per angle, that the robot is behind it, 1/s."""
    farthest_behind: float = number(0.6, limits=(0.0, 100.0), search=(0.1, 1.0), unit="m")
    """Distance that is made up for at most, m; the same number of an angle, rad."""
    integral_gain: float = number(2.0, limits=(0.0, 1e3), search=(0.0, 4.0), unit="1/s")
    """Change of the wanted velocity per velocity error and second, 1/s."""
    yaw_integral_gain: float = number(3.0, limits=(0.0, 1e3), search=(0.0, 6.0), unit="1/s")
    """The same of the yaw rate, 1/s."""
    forward_damping: float = number(6.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Acceleration per error of the forward velocity, 1/s."""
    lateral_damping: float = number(8.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """The same of the lateral one, 1/s."""
    yaw_damping: float = number(18.0, limits=(0.0, 1e4), search=(5.0, 40.0), unit="1/s")
    """Angular acceleration per error of the yaw rate, 1/s."""
    height_stiffness: float = number(120.0, limits=(0.0, 1e5), search=(50.0, 250.0), unit="1/s²")
    """Acceleration per missing height, 1/s²."""
    height_damping: float = number(16.0, limits=(0.0, 1e4), search=(8.0, 30.0), unit="1/s")
    """The same per rising speed, 1/s."""
    tilt_stiffness: float = number(200.0, limits=(0.0, 1e5), search=(80.0, 400.0), unit="1/s²")
    """Angular acceleration per tilt, 1/s²."""
    tilt_damping: float = number(30.0, limits=(0.0, 1e4), search=(12.0, 50.0), unit="1/s")
    """The same per tilt rate, 1/s."""
    rise: float = number(0.6, limits=(0.01, 100.0), unit="m/s")
    """Fastest change of the wanted height, m/s."""
    planar_priority: float = number(0.3, limits=(1e-3, 1e3), search=(0.1, 1.0))
    """Weight of the horizontal accelerations in what two feet cannot all do, by that of the vertical one."""
    tilt_priority: float = number(2.0, limits=(1e-3, 1e3), search=(0.5, 4.0), unit="m")
    """The same of the angular accelerations about the horizontal axes, m."""
    yaw_priority: float = number(0.4, limits=(1e-3, 1e3), search=(0.1, 1.0), unit="m")
    """The same of the one about the vertical, m."""
    load_time: float = number(0.03, limits=(0.0, 10.0), search=(0.0, 0.06), unit="s")
    """In which a landed foot takes over its load, and one that is to lift off gives it up, s."""
    most_force: float = number(1.4, limits=(0.1, 100.0), search=(0.9, 2.0))
    """Largest vertical force of a foot, per weight of the robot and its load."""
    friction: float = number(0.6, limits=(0.01, 2.0), search=(0.4, 0.7))
    """Horizontal force of a foot, per vertical."""
    stance_damping: float = number(4.2, limits=(0.0, 1e4), search=(0.0, 8.0), unit="1/s")
    """Force against the slip of a standing foot, per its speed and the robot's mass, 1/s."""
    early_force: float = number(70.0, limits=(0.0, 1e5), search=(30.0, 150.0), unit="N")
    """Vertical force from which a swinging foot has touched the ground before its time and is held there, N."""
    hold_error: float = number(0.6, limits=(0.0, 100.0), search=(0.3, 1.5), unit="m/s")
    """Velocity error beyond which no foot is held, m/s: a step is to catch a push."""
    hurry: float = number(0.0, limits=(0.0, 50.0), search=(0.0, 2.0), unit="Hz")
    """How much faster it steps where the velocity is far off, Hz."""
    slope_time: float = number(0.2, limits=(0.0, 1e3), search=(0.05, 0.6), unit="s")
    """Time constant with which the slope under the feet is taken in, s."""
    slope_share: float = number(1.0, limits=(0.0, 2.0), search=(0.0, 1.2))
    """Share of the slope that the trunk leans with."""

    @property
    def senses(self) -> MpcParameters:
        """Those that the senses and the footholds of the model-predictive controllers have in common with these."""
        own = {each.name for each in fields(self)} & {each.name for each in fields(MpcParameters)}
        return replace(MpcParameters(), **{name: getattr(self, name) for name in own - {"load_time"}})


FILE = ParameterFile(Path(__file__).with_name("trot_virtual.json"), VirtualParameters)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> VirtualParameters:
    """The robot's parameters, see `ParameterFile.in_force`; it steps at most `FASTEST`."""
    found = FILE.in_force(robot)
    return replace(found, frequency=min(found.frequency, FASTEST))


def ranges_of(robot: Robot = SIMPLE_QUAD) -> dict[str, tuple[float, float]]:
    """Bounds of a search for that robot, within which every trot is a slow, upright one."""
    ranges = scaled_ranges(search_ranges_of(VirtualParameters), VirtualParameters, robot)
    slow, fast = ranges["frequency"]
    return ranges | {"frequency": (slow, min(fast, FASTEST))}
