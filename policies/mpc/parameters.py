"""Parameters of the model-predictive controllers: dataclasses with default values, and the parameters of each gait."""

from dataclasses import dataclass
from pathlib import Path

from policies.parameters import ParameterFile, Parameters, parameter, scaled_parameters, search_ranges_of
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import LATERAL_LENGTH, LONGITUDINAL_LENGTH
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ModelParameters(Parameters):
    """Parameters of the model-based controllers: gait, footholds, swing trajectory and estimators."""

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(1.8, 4.5), unit="Hz")
    """Step frequency: gait cycles per second, Hz."""
    frequency_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/m")
    """Increase of the step frequency per horizontal velocity error in excess of 0.4 m/s, Hz per m/s."""
    most_faster: float = parameter(2.0, limits=(0.0, 50.0), unit="Hz")
    """Upper bound of the increase of the step frequency that a velocity error causes, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.45, 0.65))
    """Duty factor: fraction of the gait cycle in which a foot is in stance."""
    height: float = parameter(0.36, limits=(0.01, 5.0), search=(0.34, 0.48), unit="m")
    """Reference height of the hip joints above the ground, m; for SimpleQuad it equals the height of the trunk centre.
    """
    step_height: float = parameter(0.08, limits=(0.0, 2.0), search=(0.02, 0.2), unit="m")
    """Height of a swing foot above the terrain at mid-swing, m."""
    roughness_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 6.0))
    """Additional height of a swing foot at mid-swing per ground roughness, m/m.

    The ground roughness is the largest distance of a footprint (last contact position of a foot) from the plane through
    the footprints of the four feet, m."""
    width: float = parameter(0.5, limits=(0.005, 10.0), search=(0.42, 0.62), unit=LATERAL_LENGTH)
    """Lateral distance between the left and the right nominal footholds (the footholds of a robot at rest), m."""
    length: float = parameter(0.5, limits=(0.005, 10.0), search=(0.4, 0.6), unit=LONGITUDINAL_LENGTH)
    """Longitudinal distance between the fore and the hind nominal footholds (the footholds of a robot at rest), m."""
    shift: float = parameter(0.0, limits=(-2.0, 2.0), search=(-0.05, 0.05), unit="m ahead")
    """Forward distance of the centre of the four nominal footholds from the centre of mass, m.

    The nominal footholds are the footholds of a robot at rest."""
    step_gain: float = parameter(0.06, limits=(-1.0, 1.0), search=(0.0, 0.2), unit="s")
    """Shift of a foothold per velocity error (actual minus commanded) of the centre of mass, s (m per m/s)."""
    position_gain: float = parameter(0.0, limits=(0.0, 100.0), search=(0.0, 3.0), unit="1/s")
    """Gain of the position feedback, 1/s.

    The feedback adds this gain times the position error, m, to the velocity command, and this gain times the yaw error,
    rad, to the yaw-rate command. The errors are integrals of commanded minus actual velocity and yaw rate."""
    farthest_behind: float = parameter(0.6, limits=(0.0, 100.0), search=(0.1, 3.0), unit="m")
    """Bound of the forward and lateral position error in the position feedback, m; also of the yaw error, rad.

    The errors are integrals of commanded minus actual velocity and yaw rate."""
    fastest_return: float = parameter(1.2, limits=(0.0, 100.0), search=(0.5, 2.0), unit="m/s")
    """Largest horizontal speed of the velocity command after the position feedback has been added, m/s.

    The position feedback is a velocity that corrects the position error. If the command without the feedback is faster,
    the limit is the speed of this command."""
    friction: float = parameter(0.65, limits=(0.01, 2.0), search=(0.2, 0.7))
    """Friction coefficient between feet and ground that the controller assumes before a foot has slipped.

    It bounds the horizontal force along each axis, divided by the vertical force."""
    swing_stiffness: float = parameter(300.0, limits=(0.0, 1000000.0), search=(100.0, 1500.0), unit="1/s²")
    """P gain with which a swing foot tracks its trajectory: acceleration per position error of the foot, 1/s²."""
    swing_damping: float = parameter(30.0, limits=(0.0, 1e4), search=(10.0, 80.0), unit="1/s")
    """D gain with which a swing foot tracks its trajectory: acceleration per velocity error of the foot, 1/s."""
    stance_damping: float = parameter(20.0, limits=(0.0, 1e4), unit="1/s")
    """Planned deceleration of a stance foot per velocity of this foot, 1/s; it brings a moving stance foot to rest."""
    disturbance_time: float = parameter(0.3, limits=(0.02, 1e6), search=(0.1, 2.0), unit="s")
    """Time constant of the low-pass filter of the external wrench on the trunk (force and moment by pushes), s."""
    load_time: float = parameter(0.06, limits=(0.0, 1e6), search=(0.005, 0.5), unit="s")
    """Time constant of the low-pass filter of the vertical external force on the trunk, s.

    This force includes the weight of a load."""
    load_height: float = parameter(0.15, limits=(-2.0, 10.0), unit="m")
    """Height above the trunk centre at which the controller assumes a load on the trunk, m."""
    most_force: float = parameter(1.2, limits=(0.1, 100.0), search=(0.7, 2.0))
    """Largest planned vertical force on one foot, as a fraction of the weight of the robot with its load."""
    slope_time: float = parameter(0.2, limits=(0.0, 1e3), search=(0.05, 1.0), unit="s")
    """Time constant of the low-pass filter of the estimated ground slope, s."""
    touch_force: float = parameter(15.0, limits=(0.0, 100000.0), unit="N")
    """Estimated vertical force on a foot above which the foot counts as in contact with the ground, N."""
    early_force: float = parameter(20.0, limits=(0.0, 100000.0), unit="N")
    """Estimated vertical force on a swing foot above which the foot counts as landed before its swing phase ends, N."""
    search_speed: float = parameter(0.5, limits=(0.0, 50.0), search=(0.1, 1.5), unit="m/s")
    """Speed at which a foot is lowered if it should be in stance but has not touched the ground, m/s."""
    landing_depth: float = parameter(0.01, limits=(0.0, 1.0), search=(0.0, 0.04), unit="m")
    """Depth below the ground at which a swing trajectory ends, m.

    It is above 0 because a foot lags behind its trajectory and would otherwise stop above the ground."""
    lean_gain: float = parameter(1.0, limits=(0.0, 10.0), search=(0.0, 1.5))
    """Shift of the footholds in the direction of a lasting external force.

    It is a fraction: 1 stands for the shift at which the feet balance the force."""
    slip_speed: float = parameter(0.25, limits=(0.0, 10.0), search=(0.1, 0.6), unit="m/s")
    """Horizontal speed above which a foot under load counts as slipping, m/s."""
    grip_memory: float = parameter(3.0, limits=(0.01, 1e6), search=(0.5, 20.0), unit="s")
    """Time constant with which the estimated friction coefficient returns to `friction` after a slip, s."""


@dataclass(frozen=True)
class MpcParameters(ModelParameters):
    """Parameters of the model-predictive controllers: gait, estimators, and weights of the costs.

    Two controllers have weights: the MPC, which plans the contact forces, and the whole-body QP, which computes the
    joint torques.

    The defaults were set by hand on a few search episodes (episodes for the tuning of parameters). Most parameters in
    `mpc_wbc.json` were found by a parameter search.
    """

    horizon_step: float = parameter(0.04, limits=(0.001, 1.0), unit="s")
    """Duration of one step of the prediction horizon of the MPC, s."""
    plan_period: float = parameter(0.0, limits=(0.0, 1.0), unit="s")
    """Age at which a plan of the contact forces is replaced, s; with 0, every control step makes a new plan.

    If other feet are in stance than planned, the plan is replaced at once."""
    roll_weight: float = parameter(10.0, limits=(0.0, 1e6))
    """Weight of the squared roll error in the cost of the MPC, 1/rad²."""
    pitch_weight: float = parameter(10.0, limits=(0.0, 1e6))
    """Weight of the squared pitch error in the cost of the MPC, 1/rad²."""
    yaw_weight: float = parameter(2.0, limits=(0.0, 1e6))
    """Weight of the squared yaw error in the cost of the MPC, 1/rad²."""
    height_weight: float = parameter(100.0, limits=(0.0, 1e6), unit="1/m²")
    """Weight of the squared height error in the cost of the MPC, 1/m²."""
    turn_weight: float = parameter(0.1, limits=(0.0, 1e6), unit="s²")
    """Weight of the squared roll and pitch rates in the cost of the MPC, s²/rad²."""
    yaw_rate_weight: float = parameter(0.3, limits=(0.0, 1e6), unit="s²")
    """Weight of the squared yaw rate error in the cost of the MPC, s²/rad²."""
    velocity_weight: float = parameter(2.0, limits=(0.0, 1e6), unit="s²/m²")
    """Weight of the squared horizontal velocity error in the cost of the MPC, s²/m²."""
    vertical_weight: float = parameter(0.5, limits=(0.0, 1e6), unit="s²/m²")
    """Weight of the squared vertical velocity error in the cost of the MPC, s²/m²."""
    force_weight: float = parameter(1e-5, limits=(1e-12, 1000.0), unit="1/N²")
    """Weight of the squared deviation of the contact forces from an even distribution, in the cost of the MPC, 1/N².

    In the even distribution, the stance feet carry equal parts of the weight of the robot."""
    turning_priority: float = parameter(1.0, limits=(1e-6, 1e6), search=(0.1, 20.0), unit="s⁴")
    """Weight of the squared error of the trunk's angular acceleration in the whole-body QP, s⁴/rad²."""
    standing_priority: float = parameter(10.0, limits=(1e-6, 1e6), search=(0.1, 25.0), unit="s⁴/m²")
    """Weight of the squared acceleration error of stance feet in the whole-body QP, s⁴/m²."""
    swinging_priority: float = parameter(0.2, limits=(1e-6, 1e6), search=(0.02, 2.0), unit="s⁴/m²")
    """Weight of the squared acceleration error of swing feet in the whole-body QP, s⁴/m²."""
    force_priority: float = parameter(0.2, limits=(1e-09, 1000000000.0), search=(0.005, 2.0), unit="1/N²")
    """Weight of the squared deviation from the planned contact forces in the whole-body QP, 1/N²."""


TROT = "trot"
"""Name of the gait with parameters in the file `mpc_wbc.json`; the other gaits are in `OTHER_GAITS`."""

OTHER_GAITS = {
    "bound": MpcParameters(frequency=4.0, duty=0.4, length=0.4),
    "pace": MpcParameters(frequency=4.0, duty=0.5, width=0.4),
    "pronk": MpcParameters(frequency=2.8, duty=0.45),
    "walk": MpcParameters(frequency=2.0, duty=0.72),
}
"""Gait name -> parameters of this gait, for all gaits except the trot.

The parameters were set by hand on a few search episodes (episodes for the tuning of parameters)."""


SEARCH_RANGES = search_ranges_of(MpcParameters)
"""Name of a parameter -> smallest and largest number that the parameter search tries for this parameter."""
FILE = ParameterFile(Path(__file__).with_name("mpc_wbc.json"), MpcParameters)
"""File with the parameters of the trot."""


def parameters_of(gait: str, robot: Robot = SIMPLE_QUAD) -> MpcParameters:
    """Return the parameters of a gait, scaled to the size of a robot.

    The parameters of the trot are read from the file `mpc_wbc.json`. The parameters of the other gaits are in the
    dictionary `OTHER_GAITS`.

    Args:
        gait: Name of the gait: trot, bound, pace, pronk or walk.
        robot: Robot to which the parameters are scaled.

    Returns:
        Parameters of the gait.

    Raises:
        ValueError: The gait is unknown.
    """
    if gait == TROT:
        return FILE.load_for_robot(robot)
    if gait not in OTHER_GAITS:
        raise ValueError(f"unknown gait {gait!r}; valid: {', '.join(sorted((TROT, *OTHER_GAITS)))}")
    return scaled_parameters(OTHER_GAITS[gait], robot)
