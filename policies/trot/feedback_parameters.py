"""What the search of `trot_feedback` tunes: the gait, and the gain of each feedback."""

from dataclasses import dataclass
from pathlib import Path

from policies.parameters import ParameterFile, Parameters, number, search_ranges_of
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import LONG, WIDE
from quad_env.robots.simple_quad import SIMPLE_QUAD

_SHARE = (0.0, 2.0)
_GAIN = (-10.0, 10.0)


@dataclass(frozen=True)
class FeedbackParameters(Parameters):
    """Gait and gains; velocity errors are measured minus reference.

    The defaults are what the first search for success started from: the gait's own set by hand, those for rough ground,
    slopes and pushes between the outcomes of two earlier searches, which weighed falls less and more.
    """

    frequency: float = number(7.7, limits=(0.1, 50.0), search=(3.0, 9.0), unit="Hz")
    """Gait cycles a second while nothing disturbs, Hz."""
    duty: float = number(0.5, limits=(0.01, 0.99), search=(0.4, 0.65))
    """Share of the cycle that a foot is on the ground."""
    body_height: float = number(0.28, limits=(0.01, 5.0), search=(0.22, 0.36), unit="m")
    """Trunk's centre above the centres of the standing feet, m."""
    step_height: float = number(0.05, limits=(-1.0, 1.0), search=(0.03, 0.14), unit="m")
    """Lift of the foot at mid-swing, m."""
    stance_width: float = number(0.51, limits=(-10.0, 10.0), search=(0.46, 0.64), unit=WIDE)
    """Between the left and the right feet's lines, m."""
    stance_shift: float = number(-0.09, limits=(-1.0, 1.0), search=(-0.12, 0.02), unit="m ahead")
    """Middle of the strides ahead of the hip joints, m."""
    servo_lead: float = number(0.013, limits=(-1.0, 1.0), search=(0.0, 0.04), unit="s")
    """How far the targets run ahead of the planned path of the foot along its tangent, s."""
    neutral_share: float = number(0.8, limits=_GAIN, search=(-0.2, 1.2))
    """Neutral point ahead of the hip as a share of half the way that a foot passes in its stance."""
    stance_load: float = number(95.0, limits=(-1e5, 1e5), search=(20.0, 120.0), unit="N")
    """Ground force on a standing foot whose give in the joint servos the targets make up for, N."""
    blend_time: float = number(0.3, limits=(1e-3, 100.0), unit="s")
    """From the home pose to the gait at the start of an episode, s."""
    linear_acceleration: float = number(30.0, limits=(1e-3, 1e6), search=(6.0, 50.0), unit="m/s²")
    """Fastest change of the forward and of the lateral reference velocity, m/s²."""
    yaw_acceleration: float = number(60.0, limits=(1e-3, 1e6), search=(8.0, 100.0), unit="rad/s²")
    """Fastest change of the reference yaw rate, rad/s²."""
    forward_gain: float = number(1.17, limits=_GAIN, search=(0.7, 1.7))
    """Feedforward: the gait's forward velocity per reference."""
    forward_bias: float = number(0.16, limits=_GAIN, search=(-0.1, 0.6), unit="m/s ahead")
    """Added to the gait's forward velocity, m/s: all knees bend the same way, so that a gait in place drifts."""
    lateral_gain: float = number(0.93, limits=_GAIN, search=(0.7, 1.7))
    """Feedforward: the gait's lateral velocity per reference."""
    yaw_gain: float = number(1.15, limits=_GAIN, search=(0.7, 1.7))
    """Feedforward: the gait's yaw rate per reference."""
    yaw_per_lateral: float = number(-0.19, limits=_GAIN, search=(-0.5, 0.1), unit="1/m ahead")
    """Feedforward: added to the yaw rate per lateral reference velocity, rad/m: walking sideways turns the robot."""
    turn_lead: float = number(0.08, limits=_GAIN, search=(0.0, 0.4), unit="s")
    """How far ahead the gait's velocity is turned at the reference yaw rate, s: in a curve the body lags behind."""
    integral_gain: float = number(3.0, limits=_GAIN, search=(0.0, 4.0), unit="1/s")
    """Change of the gait's velocity per velocity error and second, 1/s."""
    yaw_integral_gain: float = number(2.0, limits=_GAIN, search=(0.0, 6.0), unit="1/s")
    """Change of the gait's yaw rate per yaw-rate error and second, 1/s."""
    stance_yield: float = number(0.2, limits=_SHARE, search=(0.0, 1.0))
    """Share of a velocity error that the standing feet give way to; 0 holds them to the plan."""
    stance_push: float = number(0.085, limits=_GAIN, search=(0.0, 0.15), unit="s")
    """Advance of the standing feet's targets per velocity error up to `capture_threshold`, s: legs push against it."""
    yaw_push: float = number(0.03, limits=_GAIN, search=(0.0, 0.1), unit="s")
    """The same per yaw-rate error, s."""
    sensor_filter: float = number(0.0, limits=(0.0, 100.0), search=(0.0, 0.06), unit="s")
    """Time constant of the sensor readings, s: against noise."""
    velocity_filter: float = number(0.018, limits=(1e-3, 100.0), search=(0.005, 0.2), unit="s")
    """Time constant of the velocity that footholds go by, s."""
    raibert_gain: float = number(0.04, limits=_GAIN, search=(0.0, 0.2), unit="s")
    """Foothold ahead of the neutral point per forward velocity error, s."""
    raibert_lateral: float = number(0.04, limits=_GAIN, search=(0.0, 0.2), unit="s")
    """Lateral foothold from the neutral point per lateral velocity error, s."""
    yaw_step: float = number(0.05, limits=_GAIN, search=(0.0, 0.2), unit="s")
    """Turn of the footholds about the trunk per yaw-rate error, s."""
    capture_threshold: float = number(0.632, limits=(0.0, 100.0), search=(0.2, 1.2), unit="m/s")
    """Velocity error beyond which a step is to catch a push, m/s."""
    capture_gain: float = number(0.0939, limits=_GAIN, search=(0.0, 0.2), unit="s")
    """Foothold further out per velocity error beyond the threshold, s; √(height / g) is the capture point's."""
    frequency_gain: float = number(0.219, limits=_SHARE, search=(0.0, 0.5), unit="1/(m/s)")
    """Rise of the frequency, as a share, per m/s of velocity error beyond the threshold."""
    least_following: float = number(0.0, limits=(0.0, 1.0), search=(0.0, 0.4))
    """Movement of the joints per movement of their targets below which the gait becomes slower."""
    slow_step: float = number(0.0, limits=(-1.0, 1.0), search=(0.0, 0.3), unit="m")
    """Rise of the steps per share of its frequency by which the gait is slower, m."""
    tilt_gain: float = number(0.3, limits=_GAIN, search=(0.0, 2.5))
    """Legs' answer to a tilt error, as a share of the turn that would undo it."""
    tilt_damping: float = number(0.02, limits=_GAIN, search=(0.0, 0.1), unit="s")
    """The same per tilt rate, s."""
    height_gain: float = number(0.3, limits=_GAIN, search=(-0.3, 1.5))
    """Lengthening of the standing legs per missing height."""
    height_damping: float = number(0.003, limits=_GAIN, search=(0.0, 0.05), unit="s")
    """Shortening of the standing legs per rising speed, s."""
    plane_filter: float = number(0.158, limits=(1e-3, 100.0), search=(0.05, 0.6), unit="s")
    """Time constant of the ground plane's slope, s."""
    slope_share: float = number(0.865, limits=_SHARE, search=(0.0, 1.2))
    """Share of the ground's slope that the trunk leans with."""
    terrain_compliance: float = number(0.882, limits=_SHARE, search=(0.0, 1.0))
    """Share of a footprint's height above the plane that its leg is shortened by."""
    rough_height: float = number(0.538, limits=_GAIN, search=(-1.0, 3.0))
    """Rise of the trunk per roughness of the ground, m/m."""
    rough_step: float = number(1.56, limits=_GAIN, search=(0.0, 3.0))
    """Rise of the steps per roughness of the ground, m/m."""
    rough_slowdown: float = number(55.8, limits=(0.0, 1e3), search=(0.0, 120.0), unit="1/m")
    """Slowing down by the square of this times the roughness of the ground, 1/m."""
    slope_height: float = number(0.141, limits=_GAIN, search=(-0.1, 0.4), unit="m")
    """Rise of the trunk per slope of the ground, m: longer legs reach further fore and aft."""
    slope_shift: float = number(0.0841, limits=_GAIN, search=(-0.1, 0.2), unit="m")
    """Shift of the strides uphill per slope of the ground, m."""
    slope_slowdown: float = number(1.23, limits=(0.0, 1e3), search=(0.0, 5.0))
    """Slowing down by the square of this times the slope of the ground."""
    slope_brace: float = number(0.588, limits=(0.0, 1e3), search=(0.3, 0.9))
    """Slope of the ground that is too steep to walk on: the robot stands with all feet down."""
    rough_brace: float = number(0.0241, limits=(0.0, 1e3), search=(0.01, 0.12), unit="m")
    """Roughness of the ground that is too much to walk on: the robot stands with all feet down, m."""
    hold_height: float = number(0.373, limits=(0.01, 5.0), search=(0.15, 0.4), unit="m")
    """Trunk's centre above the feet while it stands on rough ground, m."""
    hold_width: float = number(0.578, limits=(-10.0, 10.0), search=(0.46, 0.75), unit=WIDE)
    """Between the left and the right feet while it stands on rough ground, m."""
    hold_length: float = number(0.543, limits=(-10.0, 10.0), search=(0.4, 0.85), unit=LONG)
    """Between the front and the hind feet while it does, m."""
    brace_error: float = number(0.79, limits=(0.0, 1e3), search=(0.4, 2.0), unit="m/s")
    """Speed beyond the reference at which the robot begins to put all feet down to slide to rest, m/s."""
    brace_height: float = number(0.135, limits=(0.01, 5.0), search=(0.12, 0.28), unit="m")
    """Trunk's centre above the feet while it does, m."""
    brace_width: float = number(0.768, limits=(-10.0, 10.0), search=(0.5, 0.85), unit=WIDE)
    """Between the left and the right feet while it does, m."""
    brace_length: float = number(0.812, limits=(-10.0, 10.0), search=(0.45, 0.95), unit=LONG)
    """Between the front and the hind feet while it does, m."""
    brace_lead: float = number(0.0247, limits=_GAIN, search=(0.0, 0.06), unit="s")
    """Shift of the feet while it does along the way it slides, per excess speed, s."""
    brace_tilt_gain: float = number(0.96, limits=_GAIN, search=(0.0, 3.0))
    """`tilt_gain` while it does."""
    brace_tilt_damping: float = number(0.116, limits=_GAIN, search=(0.0, 0.15), unit="s")
    """`tilt_damping` while it does, s."""
    brace_release: float = number(0.172, limits=(1e-3, 100.0), search=(0.02, 0.5), unit="s")
    """From there back to the trot, s."""


SEARCH_RANGES = search_ranges_of(FeedbackParameters)
FILE = ParameterFile(Path(__file__).with_name("trot_feedback.json"), FeedbackParameters)  # TROT_FEEDBACK.md


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> FeedbackParameters:
    """The robot's parameters, see `ParameterFile.in_force`."""
    return FILE.in_force(robot)
