"""What the search of `trot_feedback` tunes: the gait, and the gain of each feedback."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from policies import bounds
from policies.base import PolicyError

PARAMETERS_FILE = Path(__file__).with_name("trot_feedback.json")
"""The parameters in force, written by `python -m train search feedback`; TROT_FEEDBACK.md is its account."""


@dataclass(frozen=True)
class FeedbackParameters:
    """Gait and gains; velocity errors are measured minus reference.

    The defaults are where the search starts: the gait's own set by hand, those for rough ground, slopes and pushes
    between the outcomes of two earlier searches, which weighed falls less and more.
    """

    frequency: float = 7.7
    """Gait cycles a second while nothing disturbs, Hz."""
    duty: float = 0.5
    """Share of the cycle that a foot is on the ground."""
    body_height: float = 0.28
    """Trunk's centre above the centres of the standing feet, m."""
    step_height: float = 0.05
    """Lift of the foot at mid-swing, m."""
    stance_width: float = 0.51
    """Between the left and the right feet's lines, m."""
    stance_shift: float = -0.09
    """Middle of the strides ahead of the hip joints, m."""
    servo_lead: float = 0.013
    """How far the targets run ahead of the planned path of the foot along its tangent, s."""
    neutral_share: float = 0.8
    """Neutral point ahead of the hip as a share of half the way that a foot passes in its stance."""
    stance_load: float = 95.0
    """Ground force on a standing foot whose give in the joint servos the targets make up for, N."""
    blend_time: float = 0.3
    """From the home pose to the gait at the start of an episode, s."""
    linear_acceleration: float = 30.0
    """Fastest change of the forward and of the lateral reference velocity, m/s²."""
    yaw_acceleration: float = 60.0
    """Fastest change of the reference yaw rate, rad/s²."""
    forward_gain: float = 1.17
    """Feedforward: the gait's forward velocity per reference."""
    forward_bias: float = 0.16
    """Added to the gait's forward velocity, m/s: all knees bend the same way, so that a gait in place drifts."""
    lateral_gain: float = 0.93
    """Feedforward: the gait's lateral velocity per reference."""
    yaw_gain: float = 1.15
    """Feedforward: the gait's yaw rate per reference."""
    yaw_per_lateral: float = -0.19
    """Feedforward: added to the yaw rate per lateral reference velocity, rad/m: walking sideways turns the robot."""
    turn_lead: float = 0.08
    """How far ahead the gait's velocity is turned at the reference yaw rate, s: in a curve the body lags behind."""
    integral_gain: float = 3.0
    """Change of the gait's velocity per velocity error and second, 1/s."""
    yaw_integral_gain: float = 2.0
    """Change of the gait's yaw rate per yaw-rate error and second, 1/s."""
    stance_yield: float = 0.2
    """Share of a velocity error that the standing feet give way to; 0 holds them to the plan."""
    stance_push: float = 0.085
    """Advance of the standing feet's targets per velocity error up to `capture_threshold`, s: legs push against it."""
    yaw_push: float = 0.03
    """The same per yaw-rate error, s."""
    velocity_filter: float = 0.018
    """Time constant of the velocity that footholds go by, s."""
    raibert_gain: float = 0.04
    """Foothold ahead of the neutral point per forward velocity error, s."""
    raibert_lateral: float = 0.04
    """Foothold beside the neutral point per lateral velocity error, s."""
    yaw_step: float = 0.05
    """Turn of the footholds about the trunk per yaw-rate error, s."""
    capture_threshold: float = 0.632
    """Velocity error beyond which a step is to catch a push, m/s."""
    capture_gain: float = 0.0939
    """Foothold further out per velocity error beyond the threshold, s; √(height / g) is the capture point's."""
    frequency_gain: float = 0.219
    """Rise of the frequency, as a share, per m/s of velocity error beyond the threshold."""
    tilt_gain: float = 0.3
    """Legs' answer to a tilt error, as a share of the turn that would undo it."""
    tilt_damping: float = 0.02
    """The same per tilt rate, s."""
    height_gain: float = 0.3
    """Lengthening of the standing legs per missing height."""
    height_damping: float = 0.003
    """Shortening of the standing legs per rising speed, s."""
    plane_filter: float = 0.158
    """Time constant of the ground plane's slope, s."""
    slope_share: float = 0.865
    """Share of the ground's slope that the trunk leans with."""
    terrain_compliance: float = 0.882
    """Share of a footprint's height above the plane that its leg is shortened by."""
    rough_height: float = 0.538
    """Rise of the trunk per roughness of the ground, m/m."""
    rough_step: float = 1.56
    """Rise of the steps per roughness of the ground, m/m."""
    rough_slowdown: float = 55.8
    """Slowing down by the square of this times the roughness of the ground, 1/m."""
    slope_height: float = 0.141
    """Rise of the trunk per slope of the ground, m: longer legs reach further fore and aft."""
    slope_shift: float = 0.0841
    """Shift of the strides uphill per slope of the ground, m."""
    slope_slowdown: float = 1.23
    """Slowing down by the square of this times the slope of the ground."""
    slope_brace: float = 0.588
    """Slope of the ground that is too steep to walk on: the robot stands with all feet down."""
    rough_brace: float = 0.0241
    """Roughness of the ground that is too much to walk on: the robot stands with all feet down, m."""
    hold_height: float = 0.373
    """Trunk's centre above the feet while it stands on rough ground, m."""
    hold_width: float = 0.578
    """Between the left and the right feet while it stands on rough ground, m."""
    hold_length: float = 0.543
    """Between the front and the hind feet while it does, m."""
    brace_error: float = 0.79
    """Speed beyond the reference at which the robot begins to put all feet down to slide to rest, m/s."""
    brace_height: float = 0.135
    """Trunk's centre above the feet while it does, m."""
    brace_width: float = 0.768
    """Between the left and the right feet while it does, m."""
    brace_length: float = 0.812
    """Between the front and the hind feet while it does, m."""
    brace_lead: float = 0.0247
    """Shift of the feet while it does along the way it slides, per excess speed, s."""
    brace_tilt_gain: float = 0.96
    """`tilt_gain` while it does."""
    brace_tilt_damping: float = 0.116
    """`tilt_damping` while it does, s."""
    brace_release: float = 0.172
    """From there back to the trot, s."""

    def __post_init__(self) -> None:
        bounds.check(self, LIMITS)


_SHARE = (0.0, 2.0)
_GAIN = (-10.0, 10.0)
LIMITS: dict[str, tuple[float, float]] = {
    "frequency": (0.1, 50.0),
    "duty": (0.01, 0.99),
    "body_height": (0.01, 1.0),
    "step_height": (-1.0, 1.0),
    "stance_width": (-2.0, 2.0),
    "stance_shift": (-1.0, 1.0),
    "servo_lead": (-1.0, 1.0),
    "neutral_share": _GAIN,
    "stance_load": (-1e3, 1e3),
    "blend_time": (1e-3, 100.0),
    "linear_acceleration": (1e-3, 1e6),
    "yaw_acceleration": (1e-3, 1e6),
    "forward_gain": _GAIN,
    "forward_bias": _GAIN,
    "lateral_gain": _GAIN,
    "yaw_gain": _GAIN,
    "yaw_per_lateral": _GAIN,
    "turn_lead": _GAIN,
    "integral_gain": _GAIN,
    "yaw_integral_gain": _GAIN,
    "stance_yield": _SHARE,
    "stance_push": _GAIN,
    "yaw_push": _GAIN,
    "velocity_filter": (1e-3, 100.0),
    "raibert_gain": _GAIN,
    "raibert_lateral": _GAIN,
    "yaw_step": _GAIN,
    "capture_threshold": (0.0, 100.0),
    "capture_gain": _GAIN,
    "frequency_gain": _SHARE,
    "tilt_gain": _GAIN,
    "tilt_damping": _GAIN,
    "height_gain": _GAIN,
    "height_damping": _GAIN,
    "plane_filter": (1e-3, 100.0),
    "slope_share": _SHARE,
    "terrain_compliance": _SHARE,
    "rough_height": _GAIN,
    "rough_step": _GAIN,
    "rough_slowdown": (0.0, 1e3),
    "slope_height": _GAIN,
    "slope_shift": _GAIN,
    "slope_slowdown": (0.0, 1e3),
    "slope_brace": (0.0, 1e3),
    "rough_brace": (0.0, 1e3),
    "hold_height": (0.01, 1.0),
    "hold_width": (-2.0, 2.0),
    "hold_length": (-2.0, 2.0),
    "brace_error": (0.0, 1e3),
    "brace_height": (0.01, 1.0),
    "brace_width": (-2.0, 2.0),
    "brace_length": (-2.0, 2.0),
    "brace_lead": _GAIN,
    "brace_tilt_gain": _GAIN,
    "brace_tilt_damping": _GAIN,
    "brace_release": (1e-3, 100.0),
}
"""Bounds of `FeedbackParameters` by field name, far beyond any use: within them every action is a finite number."""

SEARCH_RANGES: dict[str, tuple[float, float]] = {
    "frequency": (3.0, 9.0),
    "duty": (0.4, 0.65),
    "body_height": (0.22, 0.36),
    "step_height": (0.03, 0.14),
    "stance_width": (0.46, 0.64),
    "stance_shift": (-0.12, 0.02),
    "servo_lead": (0.0, 0.04),
    "neutral_share": (-0.2, 1.2),
    "stance_load": (20.0, 120.0),
    "linear_acceleration": (6.0, 50.0),
    "yaw_acceleration": (8.0, 100.0),
    "forward_gain": (0.7, 1.7),
    "forward_bias": (-0.1, 0.6),
    "lateral_gain": (0.7, 1.7),
    "yaw_gain": (0.7, 1.7),
    "yaw_per_lateral": (-0.5, 0.1),
    "turn_lead": (0.0, 0.2),
    "integral_gain": (0.0, 4.0),
    "yaw_integral_gain": (0.0, 6.0),
    "stance_yield": (0.0, 1.0),
    "stance_push": (0.0, 0.15),
    "yaw_push": (0.0, 0.1),
    "velocity_filter": (0.005, 0.2),
    "raibert_gain": (0.0, 0.2),
    "raibert_lateral": (0.0, 0.2),
    "yaw_step": (0.0, 0.2),
    "capture_threshold": (0.2, 1.2),
    "capture_gain": (0.0, 0.2),
    "frequency_gain": (0.0, 0.5),
    "tilt_gain": (0.0, 2.5),
    "tilt_damping": (0.0, 0.1),
    "height_gain": (0.0, 1.5),
    "height_damping": (0.0, 0.05),
    "plane_filter": (0.05, 0.6),
    "slope_share": (0.0, 1.2),
    "terrain_compliance": (0.0, 1.0),
    "rough_height": (0.0, 3.0),
    "rough_step": (0.0, 3.0),
    "rough_slowdown": (0.0, 120.0),
    "slope_height": (-0.1, 0.4),
    "slope_shift": (-0.1, 0.2),
    "slope_slowdown": (0.0, 5.0),
    "slope_brace": (0.3, 0.9),
    "rough_brace": (0.01, 0.12),
    "hold_height": (0.15, 0.4),
    "hold_width": (0.46, 0.75),
    "hold_length": (0.4, 0.85),
    "brace_error": (0.4, 2.0),
    "brace_height": (0.12, 0.28),
    "brace_width": (0.5, 0.85),
    "brace_length": (0.45, 0.95),
    "brace_lead": (0.0, 0.06),
    "brace_tilt_gain": (0.0, 3.0),
    "brace_tilt_damping": (0.0, 0.15),
    "brace_release": (0.05, 0.5),
}
"""Bounds within which a search of `FeedbackParameters` makes sense, by field name."""


@cache
def searched_parameters() -> FeedbackParameters:
    """The outcome of the search, from PARAMETERS_FILE. Raises PolicyError where it is missing or damaged."""
    return read_parameters(PARAMETERS_FILE)


def read_parameters(path: Path) -> FeedbackParameters:
    """Parameters from a JSON file; raises PolicyError where it is missing or damaged, or does not name them all."""
    try:
        values = json.loads(path.read_text())
        if missing := sorted(FeedbackParameters.__dataclass_fields__.keys() - values.keys()):
            raise ValueError(f"without {', '.join(missing)}")
        return FeedbackParameters(**values)
    except (AttributeError, OSError, OverflowError, TypeError, ValueError) as error:
        raise PolicyError(
            f"cannot read {path} ({error}); `python -m train search feedback` writes such a file"
        ) from None
