"""Gaits by name: footfall patterns, parameters, and frequency and duty factor at a velocity command."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from policies.gait_cycle import BOUND_OFFSETS, PACE_OFFSETS, PRONK_OFFSETS, TROT_OFFSETS, WALK_OFFSETS, Floats
from policies.parameters import CommandMap, from_json, parameter, read_parameters, scaled_parameters
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import LATERAL_LENGTH
from quad_env.robots.simple_quad import SIMPLE_QUAD

PARAMETERS_FILE = Path(__file__).with_name("gaits.json")
"""Path of the file with the searched parameters of each gait."""

OFFSETS = {
    "bound": BOUND_OFFSETS,
    "pace": PACE_OFFSETS,
    "pronk": PRONK_OFFSETS,
    "trot": TROT_OFFSETS,
    "walk": WALK_OFFSETS,
}
"""Name of each gait that steps -> phase of each leg minus the phase of the clock, order fl, fr, hl, hr, rad."""
STAND = "stand"
GAITS = (*OFFSETS, STAND)
"""Names of all gaits."""

UNLIMITED = 10.0
"""Value of a command limit that never applies, because no command reaches it, m/s or rad/s."""


@dataclass(frozen=True)
class GaitParameters(CommandMap):
    """Parameters of one gait; a change of gait interpolates all of them."""

    frequency: float = parameter(3.0, limits=(0.05, 50.0), unit="Hz")
    """Gait cycles per second if the commanded velocity is zero, Hz."""
    frequency_rise: float = parameter(0.5, limits=(0.0, 50.0), unit="Hz")
    """Increase of the frequency at Froude number 1, Hz; proportional to the root of the Froude number below 1."""
    duty: float = parameter(0.6, limits=(0.1, 0.95))
    """Duty factor, the fraction of the cycle that a foot is on the ground, if the commanded velocity is zero."""
    duty_fall: float = parameter(0.05, limits=(0.0, 0.5))
    """Decrease of the duty factor at Froude number 1; proportional to the root of the Froude number below 1."""
    body_height: float = parameter(0.32, limits=(0.01, 5.0), unit="m")
    """Height of the hip joints above the centres of the stance feet, m."""
    step_height: float = parameter(0.08, limits=(0.0, 2.0), unit="m")
    """Lift of the foot at mid-swing, m."""
    stance_width: float = parameter(0.5, limits=(0.005, 10.0), unit=LATERAL_LENGTH)
    """Lateral distance between the left and the right feet, m; at 0.5 the legs of SimpleQuad hang straight down."""
    stance_shift: float = parameter(0.0, limits=(-2.0, 2.0), unit="m ahead")
    """Forward distance of the middle of the strides from the hip joints, m."""
    bounce: float = parameter(0.0, limits=(0.0, 2.0))
    """Rise of a hip while its leg swings, as a fraction of the rise in a free flight of the same duration."""
    sway: float = parameter(0.0, limits=(-2.0, 2.0), unit="m")
    """Displacement of the trunk towards the standing feet while the feet of the other side swing, m."""
    stance_load: float = parameter(0.8, limits=(0.0, 3.0))
    """Load for which the joint targets compensate the servo sag, as a fraction of the mean load of a stance leg."""
    servo_lead: float = parameter(0.01, limits=(0.0, 1.0), unit="s")
    """Lead time of the targets along the tangent of their path, s; it compensates the lag of the joint servos."""
    forward_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Fastest forward command, m/s; a faster command is scaled down, see `limit_command`."""
    backward_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Fastest backward command, m/s."""
    lateral_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Fastest sideways command, m/s."""
    yaw_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="rad/s")
    """Fastest yaw rate command, rad/s."""


NO_LIMITS = dict.fromkeys(("forward_limit", "backward_limit", "lateral_limit", "yaw_limit"), UNLIMITED)
"""Field name of each command limit -> UNLIMITED, in the order forward, backward, lateral, yaw."""
MIN_FREQUENCY = 0.3
"""Lower bound of the frequency at any speed, Hz."""
MAX_FREQUENCY = 15.0
"""Upper bound of the frequency at any speed, Hz."""
MIN_DUTY = 0.1
"""Lower bound of the duty factor at any speed."""
MAX_DUTY = 0.95
"""Upper bound of the duty factor at any speed."""

NAMES = tuple(field.name for field in fields(GaitParameters))
INDEX = {name: column for column, name in enumerate(NAMES)}
"""Name of each parameter -> its column in an array of the parameters of n robots, (n, len(NAMES))."""


def stand_parameters(robot: Robot) -> GaitParameters:
    """Return the parameters of the gait `stand`, in which the robot stands in the home pose.

    The robot steps in place as in a walk until its feet are in place.
    """
    return GaitParameters(
        frequency=2.5,
        frequency_rise=0.0,
        duty=0.75,
        duty_fall=0.0,
        body_height=robot.home_hip_height,
        step_height=0.05,
        stance_load=0.0,
    )


def froude_number(robot: Robot, command: Floats, body_height: Floats) -> Floats:
    """Compute the Froude number v²/(g·h) of the fastest hip.

    Args:
        robot: Robot.
        command: Velocity command, (n, 3), m/s and rad/s.
        body_height: Height of the hips above the feet, (n,), m.

    Returns:
        Froude number, (n,).
    """
    hip_radius = float(np.hypot(robot.hip_positions[0, 0], robot.hip_positions[0, 1]))
    speed = np.sqrt(command[:, 0] * command[:, 0] + command[:, 1] * command[:, 1]) + hip_radius * np.abs(command[:, 2])
    return speed * speed / (GRAVITY * body_height)


def limit_command(values: Floats, command: Floats) -> Floats:
    """Limit velocity commands to the ellipsoid with the limits of the gait as half axes.

    A command outside of the ellipsoid is scaled to its surface, which keeps the direction and the turning radius.

    Args:
        values: Parameters, (n, len(NAMES)).
        command: Velocity commands, (n, 3), m/s and rad/s.

    Returns:
        Limited commands, (n, 3).
    """
    forward, backward, lateral, yaw = (values[:, INDEX[name]] for name in NO_LIMITS)
    ahead = command[:, 0] / np.where(command[:, 0] < 0.0, backward, forward)
    sideways = command[:, 1] / lateral
    turning = command[:, 2] / yaw
    size = np.sqrt(ahead * ahead + sideways * sideways + turning * turning)
    return command / np.maximum(size, 1.0)[:, None]


def gait_timing(robot: Robot, values: Floats, command: Floats) -> tuple[Floats, Floats]:
    """Compute frequency and duty factor at a commanded velocity.

    Args:
        robot: Robot.
        values: Parameters, (n, len(NAMES)).
        command: Velocity command, (n, 3), m/s and rad/s.

    Returns:
        Frequency, (n,), Hz, and duty factor, (n,).
    """
    column = INDEX
    pace = np.sqrt(np.minimum(froude_number(robot, command, values[:, column["body_height"]]), 1.0))
    frequency = values[:, column["frequency"]] + values[:, column["frequency_rise"]] * pace
    duty = values[:, column["duty"]] - values[:, column["duty_fall"]] * pace
    return np.clip(frequency, MIN_FREQUENCY, MAX_FREQUENCY), np.clip(duty, MIN_DUTY, MAX_DUTY)


def parameter_row(parameters: GaitParameters) -> Floats:
    """Return the parameters as an array in the order of NAMES, (len(NAMES),)."""
    return np.array([getattr(parameters, name) for name in NAMES], dtype=np.float64)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> dict[str, GaitParameters]:
    """Load the dictionary gait name -> searched parameters of all gaits that step, scaled to a `robot`.

    Raises PolicyError if PARAMETERS_FILE is damaged.
    """

    def decode(gaits: dict[str, Any]) -> dict[str, GaitParameters]:
        if set(gaits) != set(OFFSETS):
            raise ValueError(f"it has {', '.join(gaits)} instead of {', '.join(OFFSETS)}")
        return {name: from_json(GaitParameters, values) for name, values in gaits.items()}

    parameters = read_parameters(PARAMETERS_FILE, decode)
    return {name: scaled_parameters(gait_parameters, robot) for name, gait_parameters in parameters.items()}
