"""Trot with integral action: the integral of the velocity error is added to the command of the trot.

The open-loop trot uses only the command, not the measured velocity. A slope, a steady force, a load or a slippery floor
therefore cause a lasting velocity error. The integral action removes this error.
"""

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats
from policies.legs.level_frame import level_frame
from policies.memory import lowpass_gain, per_robot
from policies.parameters import ParameterFile, parameter, search_ranges_of
from policies.shipped import models_folder
from policies.trot.open_loop import FILE as TROT_FILE
from policies.trot.open_loop import Trot, TrotParameters, searched_parameters
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_to_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class IntegralParameters(TrotParameters):
    """Parameters of the trot with integral action: open-loop trot and integral.

    The defaults of the integral were chosen by hand on episodes with seeds that are reserved for searches.
    """

    integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Integral gain, as rate of change of the forward (lateral) correction per forward (lateral) error, 1/s.

    The correction is added to the velocity command of the trot."""
    yaw_integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Integral gain of the yaw rate, as rate of change of the yaw-rate correction per yaw-rate error, 1/s."""
    settling_time: float = parameter(0.3, limits=(0.01, 100.0), search=(0.05, 1.0), unit="s")
    """Time constant with which the expected velocity follows the command, s.

    The integral counts the error of the measured velocity relative to the expected velocity, not to the command.
    Otherwise the integral would also count the error while the robot accelerates after a new command."""
    largest_error: float = parameter(0.5, limits=(0.0, 100.0), search=(0.1, 1.0), unit="m/s")
    """Largest forward or lateral velocity error that the integral counts; a larger error is clipped.

    Larger errors are caused by a push or a fall. The limit of SimpleQuad's yaw-rate error has the same number, in
    rad/s; this limit is in m/s."""
    largest_correction: float = parameter(0.8, limits=(0.0, 100.0), search=(0.2, 2.0), unit="m/s")
    """Largest correction that the integral adds to the commanded forward or lateral velocity.

    The limit of SimpleQuad's yaw-rate correction has the same number, in rad/s; this limit is in m/s."""


SEARCH_RANGES = search_ranges_of(IntegralParameters) | {
    "forward_gain": (0.8, 2.0),
    "forward_bias": (-0.2, 0.8),
    "lateral_gain": (0.6, 1.5),
    "yaw_gain": (0.8, 1.8),
    "yaw_per_lateral": (-0.8, 0.2),
}
"""Parameter name -> (lower, upper) bound of the parameter search for the trot with integral action.

The ranges include the five parameters of the command map, see `CommandMap`. The search for the open-loop trot does not
vary these five parameters, but fits them to measured velocities."""
# Parameter file of the trot with integral action. This is a comment, because a docstring would add the constant to the
# API pages, with the path on the machine that builds them.
FILE = ParameterFile(Path(__file__).with_name("trot_integral.json"), IntegralParameters)


def integral_parameters(robot: Robot = SIMPLE_QUAD) -> IntegralParameters:
    """Return the parameters of the trot with integral action for a `robot`.

    `ParameterFile.load_for_robot` loads the parameters from `trot_integral.json`. If the robot has only a file
    `trot.json` (open-loop trot), the gait parameters are read from `trot.json`, and the parameters of the integral are
    scaled from SimpleQuad. Raises PolicyError if a file is damaged.
    """
    parameters = FILE.load_for_robot(robot)
    folder = models_folder(robot)
    if (folder / FILE.path.name).is_file() or not (folder / TROT_FILE.path.name).is_file():
        return parameters
    return replace(parameters, **asdict(searched_parameters(robot)))


class TrotIntegral(Trot):
    """Trot with integral action, which follows a velocity command with no lasting error.

    The integral of the velocity error is added to the command of the open-loop trot. The robot steps in place if the
    command is zero.
    """

    name = "trot_integral"
    parameters: IntegralParameters
    _expected: Floats = per_robot(np.zeros(3))
    """Velocity that each robot should have (forward, lateral, yaw rate), (n, 3), m/s and rad/s.

    It is the velocity command after a low-pass filter with the time constant `settling_time`."""
    _integral: Floats = per_robot(np.zeros(3))
    """Correction of the command (forward, lateral, yaw rate), the integral of the error, (n, 3), m/s and rad/s."""

    def _searched(self) -> IntegralParameters:
        return integral_parameters(self.robot)

    @cached_property
    def _limit_scale(self) -> Floats:
        """Factors on the parameters `largest_error` and `largest_correction`: (forward, lateral, yaw), (3,).

        The factor of the yaw rate converts a limit in m/s, scaled to the robot, to a limit in rad/s. All factors are 1
        for SimpleQuad.
        """
        return np.array([1.0, 1.0, scale_to_robot(self.robot, 1.0, "rad/s") / scale_to_robot(self.robot, 1.0, "m/s")])

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        p = self.parameters
        error = self._velocity_error(observation)
        max_error = p.largest_error * self._limit_scale
        max_correction = p.largest_correction * self._limit_scale
        counted = np.clip(error, -max_error, max_error)
        gains = np.array([p.integral_gain, p.integral_gain, p.yaw_integral_gain])
        integral = self._integral + self.control_period * gains * counted
        self._integral = np.clip(integral, -max_correction, max_correction)
        corrected = observation.copy()
        corrected[:, OBSERVATION["command"]] += self._integral.astype(np.float32)
        return super()._act(corrected)

    def _velocity_error(self, observation: NDArray[np.float32]) -> Floats:
        """Update the expected velocity from the command, and return the velocity error.

        The error, (n, 3), is expected minus measured forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s.
        """
        command = observation[:, OBSERVATION["command"]].astype(np.float64)
        gain = lowpass_gain(self.control_period, self.parameters.settling_time)
        self._expected = self._expected + (command - self._expected) * gain
        terms = (OBSERVATION[name] for name in ("projected_gravity", "linear_velocity", "angular_velocity"))
        gravity, velocity, angular_velocity = (observation[:, term].T.astype(np.float64) for term in terms)
        forward, lateral, _ = level_frame(gravity).to_level(velocity)
        yaw_rate = -(gravity * angular_velocity).sum(axis=0)
        error: Floats = self._expected - np.stack((forward, lateral, yaw_rate), axis=-1)
        return error
