"""Parameters of the model-predictive controllers."""

from dataclasses import dataclass
from pathlib import Path

from policies.parameters import ParameterFile, Parameters, parameter, scaled_parameters, search_ranges_of
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import LATERAL_LENGTH, LONGITUDINAL_LENGTH
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ModelParameters(Parameters):
    """Gait, footholds, swing and estimators of the model-based controllers."""

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(1.8, 4.5), unit="Hz")
    """Step frequency: gait cycles per second, Hz."""
    frequency_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/m")
    """Increase of the step frequency per velocity error above 0.4 m/s, Hz per m/s."""
    most_faster: float = parameter(2.0, limits=(0.0, 50.0), unit="Hz")
    """Largest increase of the step frequency, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.45, 0.65))
    """Duty factor: fraction of the cycle that a foot is in stance."""
    height: float = parameter(0.36, limits=(0.01, 5.0), search=(0.34, 0.48), unit="m")
    """Height of the hip joints above the ground, m; for SimpleQuad also of the trunk centre."""
    step_height: float = parameter(0.08, limits=(0.0, 2.0), search=(0.02, 0.2), unit="m")
    """Lift of a swing foot, m."""
    roughness_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 6.0))
    """Additional lift of a swing foot per roughness of the ground, see `TerrainEstimator.roughness`."""
    width: float = parameter(0.5, limits=(0.005, 10.0), search=(0.42, 0.62), unit=LATERAL_LENGTH)
    """Distance between the left and the right footholds, m."""
    length: float = parameter(0.5, limits=(0.005, 10.0), search=(0.4, 0.6), unit=LONGITUDINAL_LENGTH)
    """Distance between the fore and the hind footholds, m."""
    shift: float = parameter(0.0, limits=(-2.0, 2.0), search=(-0.05, 0.05), unit="m ahead")
    """Forward shift of the footholds from the centre of mass, m."""
    step_gain: float = parameter(0.06, limits=(-1.0, 1.0), search=(0.0, 0.2), unit="s")
    """Shift of a foothold per velocity error, s."""
    position_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/s")
    """Velocity, or yaw rate, added to the command per position error, or yaw error, 1/s."""
    farthest_behind: float = parameter(0.6, limits=(0.0, 100.0), search=(0.1, 3.0), unit="m")
    """Largest position error, m, and yaw error, rad."""
    fastest_return: float = parameter(1.2, limits=(0.0, 100.0), search=(0.5, 2.0), unit="m/s")
    """Largest speed of the corrected command, m/s. A command that is faster keeps its own speed."""
    friction: float = parameter(0.65, limits=(0.01, 2.0), search=(0.2, 0.7))
    """Friction coefficient before the first slip: largest horizontal force along each axis, per vertical force."""
    swing_stiffness: float = parameter(300.0, limits=(0.0, 1000000.0), search=(100.0, 1500.0), unit="1/s²")
    """Acceleration of a swing foot per position error, 1/s²."""
    swing_damping: float = parameter(30.0, limits=(0.0, 1e4), search=(10.0, 80.0), unit="1/s")
    """Acceleration of a swing foot per velocity error, 1/s."""
    stance_damping: float = parameter(20.0, limits=(0.0, 1e4), unit="1/s")
    """Deceleration of a stance foot per velocity, 1/s."""
    disturbance_time: float = parameter(0.3, limits=(0.02, 1e6), search=(0.1, 2.0), unit="s")
    """Time constant of the external wrench, s."""
    load_time: float = parameter(0.06, limits=(0.0, 1e6), search=(0.005, 0.5), unit="s")
    """Time constant of the vertical force of the external wrench, s."""
    load_height: float = parameter(0.15, limits=(-2.0, 10.0), unit="m")
    """Height of a load above the trunk centre, m."""
    most_force: float = parameter(1.2, limits=(0.1, 100.0), search=(0.7, 2.0))
    """Largest vertical force on a foot, as a fraction of the weight of the robot with its load."""
    slope_time: float = parameter(0.2, limits=(0.0, 1e3), search=(0.05, 1.0), unit="s")
    """Time constant of the slope of the ground, s."""
    touch_force: float = parameter(15.0, limits=(0.0, 100000.0), unit="N")
    """Vertical force from which a foot is in contact, N."""
    early_force: float = parameter(20.0, limits=(0.0, 100000.0), unit="N")
    """Vertical force from which a swing foot has landed early, N."""
    search_speed: float = parameter(0.5, limits=(0.0, 50.0), search=(0.1, 1.5), unit="m/s")
    """Downward speed of a stance foot without contact, m/s."""
    landing_depth: float = parameter(0.01, limits=(0.0, 1.0), search=(0.0, 0.04), unit="m")
    """Depth below the ground at which a swing trajectory ends, m; above 0 because feet lag behind the trajectory."""
    lean_gain: float = parameter(1.0, limits=(0.0, 10.0), search=(0.0, 1.5))
    """Shift of the footholds against a lasting force, as a fraction of the shift that balances the force."""
    slip_speed: float = parameter(0.25, limits=(0.0, 10.0), search=(0.1, 0.6), unit="m/s")
    """Horizontal speed from which a loaded foot slips, m/s."""
    grip_memory: float = parameter(3.0, limits=(0.01, 1e6), search=(0.5, 20.0), unit="s")
    """Time constant with which the friction estimate returns to `friction` after a slip, s."""


@dataclass(frozen=True)
class MpcParameters(ModelParameters):
    """Gait, cost and gains.

    The defaults were set by hand on a few search episodes; the values in `mpc_wbc.json` were searched.
    """

    horizon_step: float = parameter(0.04, limits=(0.001, 1.0), unit="s")
    """Duration of a step of the horizon, s."""
    plan_period: float = parameter(0.0, limits=(0.0, 1.0), unit="s")
    """Time between two force plans while the stance feet are as planned, s; 0 for a plan in every control step."""
    roll_weight: float = parameter(10.0, limits=(0.0, 1e6))
    """Weight of the roll error."""
    pitch_weight: float = parameter(10.0, limits=(0.0, 1e6))
    """Weight of the pitch error."""
    yaw_weight: float = parameter(2.0, limits=(0.0, 1e6))
    """Weight of the yaw error."""
    height_weight: float = parameter(100.0, limits=(0.0, 1e6), unit="1/m²")
    """Weight of the height error."""
    turn_weight: float = parameter(0.1, limits=(0.0, 1e6), unit="s²")
    """Weight of the roll and pitch rates."""
    yaw_rate_weight: float = parameter(0.3, limits=(0.0, 1e6), unit="s²")
    """Weight of the yaw rate error."""
    velocity_weight: float = parameter(2.0, limits=(0.0, 1e6), unit="s²/m²")
    """Weight of the horizontal velocity error."""
    vertical_weight: float = parameter(0.5, limits=(0.0, 1e6), unit="s²/m²")
    """Weight of the vertical velocity error."""
    force_weight: float = parameter(1e-5, limits=(1e-12, 1000.0), unit="1/N²")
    """Weight of the squared contact forces, 1/N²."""
    turning_priority: float = parameter(1.0, limits=(1e-6, 1e6), search=(0.1, 20.0), unit="s⁴")
    """Weight of the angular acceleration of the trunk in the whole-body QP, s⁴/rad²."""
    standing_priority: float = parameter(10.0, limits=(1e-6, 1e6), search=(0.1, 25.0), unit="s⁴/m²")
    """Weight of the accelerations of stance feet in the whole-body QP, s⁴/m²."""
    swinging_priority: float = parameter(0.2, limits=(1e-6, 1e6), search=(0.02, 2.0), unit="s⁴/m²")
    """Weight of the accelerations of swing feet in the whole-body QP, s⁴/m²."""
    force_priority: float = parameter(0.2, limits=(1e-09, 1000000000.0), search=(0.005, 2.0), unit="1/N²")
    """Weight of the contact forces in the whole-body QP, 1/N²."""


TROT = "trot"

OTHER_GAITS = {
    "bound": MpcParameters(frequency=4.0, duty=0.4, length=0.4),
    "pace": MpcParameters(frequency=4.0, duty=0.5, width=0.4),
    "pronk": MpcParameters(frequency=2.8, duty=0.45),
    "walk": MpcParameters(frequency=2.0, duty=0.72),
}
"""Name of each gait other than the trot -> its parameters, which were set by hand on a few search episodes."""


SEARCH_RANGES = search_ranges_of(MpcParameters)
FILE = ParameterFile(Path(__file__).with_name("mpc_wbc.json"), MpcParameters)


def parameters_of(gait: str, robot: Robot = SIMPLE_QUAD) -> MpcParameters:
    """Return the parameters of a gait.

    Args:
        gait: Name.
        robot: Robot that the parameters are scaled to.

    Returns:
        Searched parameters for the trot, entries of `OTHER_GAITS` scaled to the robot for other gaits.

    Raises:
        ValueError: The gait is unknown.
    """
    if gait == TROT:
        return FILE.load_for_robot(robot)
    if gait not in OTHER_GAITS:
        raise ValueError(f"unknown gait {gait!r}; valid: {', '.join(sorted((TROT, *OTHER_GAITS)))}")
    return scaled_parameters(OTHER_GAITS[gait], robot)
