"""Parameters of the gaits walk, trot, pace, bound, pronk and stand.

The parameters define the footfall patterns, the frequency and duty factor at a commanded velocity, and the velocity
limits.
"""

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
"""Path of the JSON file with the parameters of each stepping gait for SimpleQuad, which a search has found."""

OFFSETS = {
    "bound": BOUND_OFFSETS,
    "pace": PACE_OFFSETS,
    "pronk": PRONK_OFFSETS,
    "trot": TROT_OFFSETS,
    "walk": WALK_OFFSETS,
}
"""Name of each stepping gait -> phase offsets of the legs (fl, fr, hl, hr) from the gait clock, rad."""
STAND = "stand"
"""Name of the gait in which a robot stands still."""
GAITS = (*OFFSETS, STAND)
"""Names of all gaits: the stepping gaits bound, pace, pronk, trot and walk, and `stand`."""

UNLIMITED = 10.0
"""Velocity limit that has no effect, m/s or rad/s, because no velocity command is as large as this number."""


@dataclass(frozen=True)
class GaitParameters(CommandMap):
    """Parameters of one gait, such as frequency, duty factor, step height and velocity limits.

    In a transition between two gaits, all parameters are interpolated.
    """

    frequency: float = parameter(3.0, limits=(0.05, 50.0), unit="Hz")
    """Gait frequency, the number of gait cycles per second, at a commanded velocity of zero, Hz."""
    frequency_rise: float = parameter(0.5, limits=(0.0, 50.0), unit="Hz")
    """Increase of the gait frequency at a commanded velocity with Froude number 1, Hz.

    Below Froude number 1, the increase is proportional to the square root of the Froude number, and thus to the
    commanded speed. See `froude_number`."""
    duty: float = parameter(0.6, limits=(0.1, 0.95))
    """Duty factor, the fraction of the gait cycle that a foot is on the ground, at a commanded velocity of zero."""
    duty_fall: float = parameter(0.05, limits=(0.0, 0.5))
    """Decrease of the duty factor at a commanded velocity with Froude number 1.

    Below Froude number 1, the decrease is proportional to the square root of the Froude number, and thus to the
    commanded speed. See `froude_number`."""
    body_height: float = parameter(0.32, limits=(0.01, 5.0), unit="m")
    """Height of the hip joints above the centres of the stance feet, m."""
    step_height: float = parameter(0.08, limits=(0.0, 2.0), unit="m")
    """Height of a swing foot above the stance feet at mid-swing, m."""
    stance_width: float = parameter(0.5, limits=(0.005, 10.0), unit=LATERAL_LENGTH)
    """Lateral distance between the left and the right feet, m; at 0.5 the legs of SimpleQuad hang straight down."""
    stance_shift: float = parameter(0.0, limits=(-2.0, 2.0), unit="m ahead")
    """Forward position of the middle of the stride of each foot, relative to its hip joint, m."""
    bounce: float = parameter(0.0, limits=(0.0, 2.0))
    """Scale of the vertical motion of the hips over a gait cycle, dimensionless; 0 for a constant height.

    With 1, a hip follows a ballistic flight while its leg swings, see `hip_bounce`."""
    sway: float = parameter(0.0, limits=(-2.0, 2.0), unit="m")
    """Lateral displacement of the trunk per swing foot, away from the side of this foot, m.

    In the pace, both feet of a side swing together, so that the amplitude is twice this value."""
    stance_load: float = parameter(0.8, limits=(0.0, 3.0))
    """Compensated force at mid-stance, as a fraction of the mean force on a stance foot, dimensionless.

    Servos sag under the force on a stance foot. The joint targets compensate the sag for a force that rises from zero
    at touch-down to this value and falls back to zero at lift-off. The mean force on a stance foot is the weight of the
    robot / (number of legs · duty factor)."""
    servo_lead: float = parameter(0.01, limits=(0.0, 1.0), unit="s")
    """Lead time of the joint targets, which compensates the lag of the servos, s.

    A joint target is the wanted angle plus the lead time times the rate of change of the wanted angle."""
    forward_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Largest forward velocity of the gait, m/s; a larger command is scaled down, see `limit_command`."""
    backward_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Largest backward velocity of the gait, m/s; a larger command is scaled down, see `limit_command`."""
    lateral_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="m/s")
    """Largest lateral velocity of the gait, m/s; a larger command is scaled down, see `limit_command`."""
    yaw_limit: float = parameter(UNLIMITED, limits=(0.01, 100.0), unit="rad/s")
    """Largest yaw rate of the gait, rad/s; a larger command is scaled down, see `limit_command`."""


NO_LIMITS = dict.fromkeys(("forward_limit", "backward_limit", "lateral_limit", "yaw_limit"), UNLIMITED)
"""Velocity limits of a gait that follows every command: field name of `GaitParameters` -> `UNLIMITED`.

The order of the fields is forward, backward, lateral and yaw velocity."""
MIN_FREQUENCY = 0.3
"""Lower limit of the gait frequency at every commanded velocity, Hz."""
MAX_FREQUENCY = 15.0
"""Upper limit of the gait frequency at every commanded velocity, Hz."""
MIN_DUTY = 0.1
"""Lower limit of the duty factor (fraction of the gait cycle in stance) at every commanded velocity."""
MAX_DUTY = 0.95
"""Upper limit of the duty factor (fraction of the gait cycle in stance) at every commanded velocity."""

NAMES = tuple(field.name for field in fields(GaitParameters))
"""Names of all gait parameters, the fields of `GaitParameters`, in the order of the columns of a parameter array."""
INDEX = {name: column for column, name in enumerate(NAMES)}
"""Name of each gait parameter -> its column in an array with the parameters of n robots, (n, len(NAMES))."""


def stand_parameters(robot: Robot) -> GaitParameters:
    """Return the parameters of the gait `stand`, in which a `robot` stands in its home pose.

    A robot that changes to this gait steps in place, as in a walk, until its feet are at their home positions.
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
    """Compute the Froude number v²/(g·h) of the commanded velocity.

    Here v is the commanded speed of the fastest hip, g is the gravitational acceleration, and h is the hip height.

    Args:
        robot: Robot with the hip positions.
        command: Velocity command (forward, lateral, yaw rate), (n, 3), m/s and rad/s.
        body_height: Height h of the hips above the feet, (n,), m.

    Returns:
        Froude number of each robot, (n,).
    """
    hip_radius = float(np.hypot(robot.hip_positions[0, 0], robot.hip_positions[0, 1]))
    speed = np.sqrt(command[:, 0] * command[:, 0] + command[:, 1] * command[:, 1]) + hip_radius * np.abs(command[:, 2])
    return speed * speed / (GRAVITY * body_height)


def limit_command(values: Floats, command: Floats) -> Floats:
    """Scale velocity commands down to the velocity limits of the gait.

    The velocity limits are the half axes of an ellipsoid. A command outside of the ellipsoid is scaled to its surface.
    The scaling keeps the direction of motion and the turning radius.

    Args:
        values: Gait parameters of n robots, with the columns of `INDEX`, (n, len(NAMES)).
        command: Velocity commands (forward, lateral, yaw rate), (n, 3), m/s and rad/s.

    Returns:
        Limited velocity commands, (n, 3), m/s and rad/s.
    """
    forward, backward, lateral, yaw = (values[:, INDEX[name]] for name in NO_LIMITS)
    ahead = command[:, 0] / np.where(command[:, 0] < 0.0, backward, forward)
    sideways = command[:, 1] / lateral
    turning = command[:, 2] / yaw
    size = np.sqrt(ahead * ahead + sideways * sideways + turning * turning)
    return command / np.maximum(size, 1.0)[:, None]


def gait_timing(robot: Robot, values: Floats, command: Floats) -> tuple[Floats, Floats]:
    """Compute the gait frequency and the duty factor for the commanded velocity of each robot.

    Args:
        robot: Robot with the hip positions.
        values: Gait parameters of n robots, with the columns of `INDEX`, (n, len(NAMES)).
        command: Velocity command (forward, lateral, yaw rate), (n, 3), m/s and rad/s.

    Returns:
        Two arrays: gait frequency, (n,), Hz, and duty factor (fraction of the gait cycle in stance), (n,).
    """
    column = INDEX
    pace = np.sqrt(np.minimum(froude_number(robot, command, values[:, column["body_height"]]), 1.0))
    frequency = values[:, column["frequency"]] + values[:, column["frequency_rise"]] * pace
    duty = values[:, column["duty"]] - values[:, column["duty_fall"]] * pace
    return np.clip(frequency, MIN_FREQUENCY, MAX_FREQUENCY), np.clip(duty, MIN_DUTY, MAX_DUTY)


def parameter_row(parameters: GaitParameters) -> Floats:
    """Return the `parameters` of a gait as an array, (len(NAMES),), in the order of `NAMES`."""
    return np.array([getattr(parameters, name) for name in NAMES], dtype=np.float64)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> dict[str, GaitParameters]:
    """Load the parameters of all stepping gaits from `PARAMETERS_FILE`, and scale them to a `robot`.

    A search has found the parameters for SimpleQuad. The result is a dictionary gait name -> parameters. Raises
    PolicyError if `PARAMETERS_FILE` is damaged.
    """

    def decode(gaits: dict[str, Any]) -> dict[str, GaitParameters]:
        if set(gaits) != set(OFFSETS):
            raise ValueError(f"it has {', '.join(gaits)} instead of {', '.join(OFFSETS)}")
        return {name: from_json(GaitParameters, values) for name, values in gaits.items()}

    parameters = read_parameters(PARAMETERS_FILE, decode)
    return {name: scaled_parameters(gait_parameters, robot) for name, gait_parameters in parameters.items()}
