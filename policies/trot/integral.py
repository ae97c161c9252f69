"""Trot with integral action: the integral of the velocity error is added to the command of the trot.

The command is the only input of the trot. A slope, a steady force, a load or a slippery floor therefore cause a lasting
velocity error, which the integral removes.
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
    """Parameters of the trot and of the integral.

    The defaults of the integral were chosen by hand on search episodes.
    """

    integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Rate of the velocity correction per velocity error, 1/s."""
    yaw_integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Rate of the yaw-rate correction per yaw-rate error, 1/s."""
    settling_time: float = parameter(0.3, limits=(0.01, 100.0), search=(0.05, 1.0), unit="s")
    """Time constant of the expected velocity after a new command, s; the velocity error is relative to it."""
    largest_error: float = parameter(0.5, limits=(0.0, 100.0), search=(0.1, 1.0), unit="m/s")
    """Largest velocity error that the integral counts, because a larger error is caused by a push or a fall.

    The limit of SimpleQuad's yaw-rate error has the same number, in rad/s; this limit is in m/s."""
    largest_correction: float = parameter(0.8, limits=(0.0, 100.0), search=(0.2, 2.0), unit="m/s")
    """Largest correction of each velocity.

    The limit of SimpleQuad's yaw-rate correction has the same number, in rad/s; this limit is in m/s."""


SEARCH_RANGES = search_ranges_of(IntegralParameters) | {
    "forward_gain": (0.8, 2.0),
    "forward_bias": (-0.2, 0.8),
    "lateral_gain": (0.6, 1.5),
    "yaw_gain": (0.8, 1.8),
    "yaw_per_lateral": (-0.8, 0.2),
}
"""Parameter name -> bounds of a search, also for the command map, which the search of the trot fits instead."""
FILE = ParameterFile(Path(__file__).with_name("trot_integral.json"), IntegralParameters)  # TROT_INTEGRAL.md


def integral_parameters(robot: Robot = SIMPLE_QUAD) -> IntegralParameters:
    """Return the parameters of the integral trot for a `robot`, see `ParameterFile`.

    If only the trot of the robot was searched, the function takes the parameters of that trot and the scaled parameters
    of the integral. Raises PolicyError if the file is missing or damaged.
    """
    parameters = FILE.load_for_robot(robot)
    folder = models_folder(robot)
    if (folder / FILE.path.name).is_file() or not (folder / TROT_FILE.path.name).is_file():
        return parameters
    return replace(parameters, **asdict(searched_parameters(robot)))


class TrotIntegral(Trot):
    """Trot that follows a velocity command without a lasting error; steps in place if the command is zero."""

    name = "trot_integral"
    parameters: IntegralParameters
    _expected: Floats = per_robot(np.zeros(3))
    _integral: Floats = per_robot(np.zeros(3))

    def _searched(self) -> IntegralParameters:
        return integral_parameters(self.robot)

    @cached_property
    def _limit_scale(self) -> Floats:
        """Factors on the limits for forward, lateral and yaw velocity, (3,); all are 1 on SimpleQuad."""
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
        """Update the expected velocity, and return expected minus measured velocity, (n, 3), m/s and rad/s."""
        command = observation[:, OBSERVATION["command"]].astype(np.float64)
        gain = lowpass_gain(self.control_period, self.parameters.settling_time)
        self._expected = self._expected + (command - self._expected) * gain
        terms = (OBSERVATION[name] for name in ("projected_gravity", "linear_velocity", "angular_velocity"))
        gravity, velocity, angular_velocity = (observation[:, term].T.astype(np.float64) for term in terms)
        forward, lateral, _ = level_frame(gravity).to_level(velocity)
        yaw_rate = -(gravity * angular_velocity).sum(axis=0)
        error: Floats = self._expected - np.stack((forward, lateral, yaw_rate), axis=-1)
        return error
