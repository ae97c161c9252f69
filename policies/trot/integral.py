"""The trot with integral action: its command is corrected by what the robot has so far fallen short of it.

The trot looks at nothing but the command, so that a slope, a steady force, a load or a slippery floor carry the robot
off it for good. Here the integral of the velocity error is added to the command that the trot follows.
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
    """The trot's, and those of the integral, whose defaults were chosen by hand on search episodes."""

    integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Change of the followed velocity per velocity error, 1/s."""
    yaw_integral_gain: float = parameter(1.0, limits=(0.0, 100.0), search=(0.0, 4.0), unit="1/s")
    """Change of the followed yaw rate per error, 1/s."""
    settling_time: float = parameter(0.3, limits=(0.01, 100.0), search=(0.05, 1.0), unit="s")
    """Time constant with which the robot is expected to take up a new command, s: until then it makes no error."""
    largest_error: float = parameter(0.5, limits=(0.0, 100.0), search=(0.1, 1.0), unit="m/s")
    """Velocity error that is counted at most, m/s: beyond is a push or a fall, no bias. The same number of SimpleQuad's
    yaw rate, rad/s."""
    largest_correction: float = parameter(0.8, limits=(0.0, 100.0), search=(0.2, 2.0), unit="m/s")
    """Of each velocity, m/s: the same number of SimpleQuad's yaw rate, rad/s."""


SEARCH_RANGES = search_ranges_of(IntegralParameters) | {
    "forward_gain": (0.8, 2.0),
    "forward_bias": (-0.2, 0.8),
    "lateral_gain": (0.6, 1.5),
    "yaw_gain": (0.8, 1.8),
    "yaw_per_lateral": (-0.8, 0.2),
}
"""With those of the command map, which the trot's search fits."""
FILE = ParameterFile(Path(__file__).with_name("trot_integral.json"), IntegralParameters)  # TROT_INTEGRAL.md


def integral_parameters(robot: Robot = SIMPLE_QUAD) -> IntegralParameters:
    """The parameters in force, see `ParameterFile`; of a robot whose trot alone was searched, with that trot's. Raises
    PolicyError where they are missing or damaged."""
    found, folder = FILE.load_for_robot(robot), models_folder(robot)
    if (folder / FILE.path.name).is_file() or not (folder / TROT_FILE.path.name).is_file():
        return found
    return replace(found, **asdict(searched_parameters(robot)))


class TrotIntegral(Trot):
    """Command-following trot without a lasting velocity error; steps in place at zero command."""

    name = "trot_integral"
    parameters: IntegralParameters
    _expected: Floats = per_robot(np.zeros(3))
    _integral: Floats = per_robot(np.zeros(3))

    def _searched(self) -> IntegralParameters:
        return integral_parameters(self.robot)

    @cached_property
    def _each(self) -> Floats:
        """Of a number of m/s and of rad/s, which are not alike on other robots than SimpleQuad."""
        return np.array([1.0, 1.0, scale_to_robot(self.robot, 1.0, "rad/s") / scale_to_robot(self.robot, 1.0, "m/s")])

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        command = observation[:, OBSERVATION["command"]].astype(np.float64)
        p, period = self.parameters, self.control_period
        self._expected = self._expected + (command - self._expected) * lowpass_gain(period, p.settling_time)
        terms = (OBSERVATION[name] for name in ("projected_gravity", "linear_velocity", "angular_velocity"))
        gravity, velocity, turn = (observation[:, term].T.astype(np.float64) for term in terms)
        forward, lateral, _ = level_frame(gravity).to_level(velocity)
        error = self._expected - np.stack((forward, lateral, -(gravity * turn).sum(axis=0)), axis=-1)
        largest, most = p.largest_error * self._each, p.largest_correction * self._each
        counted = np.clip(error, -largest, largest)
        gains = np.array([p.integral_gain, p.integral_gain, p.yaw_integral_gain])
        self._integral = np.clip(self._integral + period * gains * counted, -most, most)
        corrected = observation.copy()
        corrected[:, OBSERVATION["command"]] += self._integral.astype(np.float32)
        return super()._act(corrected)
