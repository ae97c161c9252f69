"""Parameters of the model-predictive controllers."""

from dataclasses import dataclass
from pathlib import Path

from policies.parameters import ParameterFile, Parameters, parameter, scaled_parameters, search_ranges_of
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import LATERAL_LENGTH, LONGITUDINAL_LENGTH
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ModelParameters(Parameters):
    """Gait, footholds, swing and senses of the controllers that know the robot's model."""

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(1.8, 4.5), unit="Hz")
    """Gait cycles a second, Hz."""
    frequency_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/m")
    """How much faster it steps per velocity error beyond 0.4 m/s, Hz per m/s."""
    most_faster: float = parameter(2.0, limits=(0.0, 50.0), unit="Hz")
    """Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.45, 0.65))
    """Share of the cycle that a foot is on the ground."""
    height: float = parameter(0.36, limits=(0.01, 5.0), search=(0.34, 0.48), unit="m")
    """Hip joints above the ground, m; of SimpleQuad the trunk's centre too."""
    step_height: float = parameter(0.08, limits=(0.0, 2.0), search=(0.02, 0.2), unit="m")
    """Lift of a swinging foot, m."""
    roughness_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 6.0))
    """Lift added per roughness of the ground, the distance of the footprints from their plane."""
    width: float = parameter(0.5, limits=(0.005, 10.0), search=(0.42, 0.62), unit=LATERAL_LENGTH)
    """Between the lines of the left and the right feet, m."""
    length: float = parameter(0.5, limits=(0.005, 10.0), search=(0.4, 0.6), unit=LONGITUDINAL_LENGTH)
    """Between the lines of the fore and the hind feet, m."""
    shift: float = parameter(0.0, limits=(-2.0, 2.0), search=(-0.05, 0.05), unit="m ahead")
    """Middle of the feet ahead of the centre of mass, m."""
    step_gain: float = parameter(0.06, limits=(-1.0, 1.0), search=(0.0, 0.2), unit="s")
    """A foot is put further out by this times the velocity error, s."""
    position_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/s")
    """Velocity added to the command per distance, and yaw rate per angle, that the robot is behind it, 1/s."""
    farthest_behind: float = parameter(0.6, limits=(0.0, 100.0), search=(0.1, 3.0), unit="m")
    """Distance that is made up for at most, m; the same number of an angle, rad."""
    fastest_return: float = parameter(1.2, limits=(0.0, 100.0), search=(0.5, 2.0), unit="m/s")
    """Largest planar speed that is asked for to make up for it, m/s; where the command is faster, that one's."""
    friction: float = parameter(0.65, limits=(0.01, 2.0), search=(0.2, 0.7))
    """Horizontal force of a foot along each axis, per vertical."""
    swing_stiffness: float = parameter(300.0, limits=(0.0, 1000000.0), search=(100.0, 1500.0), unit="1/s²")
    """Acceleration of a swinging foot per distance from its path, 1/s²."""
    swing_damping: float = parameter(30.0, limits=(0.0, 1e4), search=(10.0, 80.0), unit="1/s")
    """The same per velocity error, 1/s."""
    stance_damping: float = parameter(20.0, limits=(0.0, 1e4), unit="1/s")
    """Deceleration asked of a stance foot, 1/s."""
    disturbance_time: float = parameter(0.3, limits=(0.02, 1e6), search=(0.1, 2.0), unit="s")
    """Time constant with which the rigid body's acceleration is corrected by what was observed, s."""
    load_time: float = parameter(0.06, limits=(0.0, 1e6), search=(0.005, 0.5), unit="s")
    """The same of the vertical force, s."""
    load_height: float = parameter(0.15, limits=(-2.0, 10.0), unit="m")
    """Centre of a load above the trunk's centre, m."""
    most_force: float = parameter(1.2, limits=(0.1, 100.0), search=(0.7, 2.0))
    """Largest vertical force of a foot, per weight of the robot and its load."""
    slope_time: float = parameter(0.2, limits=(0.0, 1e3), search=(0.05, 1.0), unit="s")
    """Time constant with which the slope under the feet is taken in, s."""
    touch_force: float = parameter(15.0, limits=(0.0, 100000.0), unit="N")
    """Vertical force, N, from which a foot is taken to touch the ground."""
    early_force: float = parameter(20.0, limits=(0.0, 100000.0), unit="N")
    """Vertical force, N, from which a foot has touched the ground before its time."""
    search_speed: float = parameter(0.5, limits=(0.0, 50.0), search=(0.1, 1.5), unit="m/s")
    """Downward speed of a foot that should stand and does not touch the ground, m/s."""
    landing_depth: float = parameter(0.01, limits=(0.0, 1.0), search=(0.0, 0.04), unit="m")
    """How far below the ground the path of a swinging foot ends, m: feet follow it late."""
    lean_gain: float = parameter(1.0, limits=(0.0, 10.0), search=(0.0, 1.5))
    """Shift of the footholds against a lasting force, as a share of what balances it."""
    slip_speed: float = parameter(0.25, limits=(0.0, 10.0), search=(0.1, 0.6), unit="m/s")
    """Horizontal speed of a loaded foot that is taken for slipping, m/s."""
    grip_memory: float = parameter(3.0, limits=(0.01, 1e6), search=(0.5, 20.0), unit="s")
    """Time constant with which a slip is forgotten, s."""


@dataclass(frozen=True)
class MpcParameters(ModelParameters):
    """Gait, cost and gains; the defaults were set by hand on a few search episodes, those in force were searched."""

    horizon_step: float = parameter(0.04, limits=(0.001, 1.0), unit="s")
    """Of the prediction, s."""
    plan_period: float = parameter(0.0, limits=(0.0, 1.0), unit="s")
    """Between two plans while the feet stand as planned, s; 0 for one at every control step."""
    roll_weight: float = parameter(10.0, limits=(0.0, 1e6))
    pitch_weight: float = parameter(10.0, limits=(0.0, 1e6))
    yaw_weight: float = parameter(2.0, limits=(0.0, 1e6))
    height_weight: float = parameter(100.0, limits=(0.0, 1e6), unit="1/m²")
    turn_weight: float = parameter(0.1, limits=(0.0, 1e6), unit="s²")
    """Of the rates of roll and pitch."""
    yaw_rate_weight: float = parameter(0.3, limits=(0.0, 1e6), unit="s²")
    velocity_weight: float = parameter(2.0, limits=(0.0, 1e6), unit="s²/m²")
    """Of the horizontal velocity error."""
    vertical_weight: float = parameter(0.5, limits=(0.0, 1e6), unit="s²/m²")
    """Of the vertical velocity."""
    force_weight: float = parameter(1e-5, limits=(1e-12, 1000.0), unit="1/N²")
    """Per squared newton."""
    turning_priority: float = parameter(1.0, limits=(1e-6, 1e6), search=(0.1, 20.0), unit="s⁴")
    """Weight of the trunk's angular acceleration in the whole body's program, s⁴/rad²."""
    standing_priority: float = parameter(10.0, limits=(1e-6, 1e6), search=(0.1, 25.0), unit="s⁴/m²")
    """The same of the accelerations of stance feet, s⁴/m²."""
    swinging_priority: float = parameter(0.2, limits=(1e-6, 1e6), search=(0.02, 2.0), unit="s⁴/m²")
    """The same of swinging feet."""
    force_priority: float = parameter(0.2, limits=(1e-09, 1000000000.0), search=(0.005, 2.0), unit="1/N²")
    """The same of the feet's forces, 1/N²."""


TROT = "trot"

OTHER_GAITS = {
    "bound": MpcParameters(frequency=4.0, duty=0.4, length=0.4),
    "pace": MpcParameters(frequency=4.0, duty=0.5, width=0.4),
    "pronk": MpcParameters(frequency=2.8, duty=0.45),
    "walk": MpcParameters(frequency=2.0, duty=0.72),
}
"""Than the trot, by name, set by hand on a few search episodes."""


SEARCH_RANGES = search_ranges_of(MpcParameters)
FILE = ParameterFile(Path(__file__).with_name("mpc_wbc.json"), MpcParameters)


def parameters_of(gait: str, robot: Robot = SIMPLE_QUAD) -> MpcParameters:
    """Those in force of a gait. Raises ValueError for an unknown one."""
    if gait == TROT:
        return FILE.load_for_robot(robot)
    if gait not in OTHER_GAITS:
        raise ValueError(f"unknown gait {gait!r}; there are {', '.join(sorted((TROT, *OTHER_GAITS)))}")
    return scaled_parameters(OTHER_GAITS[gait], robot)
