"""Domain randomisation: ranges of the properties of robot and ground, and their random draws per episode."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from quad_env.columns import Array
from quad_env.config import Bounds, NonNegative, Positive, Settings
from quad_env.scenarios.disturbances import Delay

LargeFraction = Annotated[float, Bounds("from 0 to 0.9", 0.0, 0.9)]


class RandomizationSample(NamedTuple):
    """Randomised properties of robot and ground in one episode, drawn by `DomainRandomisation.draw`."""

    friction: float
    """Factor on the ground's friction coefficient."""
    trunk_mass: float
    """Factor on the trunk's mass."""
    centre_of_mass: Array
    """Displacement of the trunk's centre of mass, base frame (forward, left, up), (3,), m."""
    stiffness: Array
    """Factor on the stiffness of each joint servo, (12,)."""
    damping: Array
    """Factor on the damping of each joint servo, (12,)."""
    motor_strength: Array
    """Factor on the torque limit of each joint servo, (12,)."""
    delay: float
    """Delay of the joint targets from the policy to the servos, in addition to the scenario's latency, s."""
    encoder_offset: Array
    """Offset that is added to the reading of each joint encoder, (12,), rad."""


@dataclass(frozen=True)
class DomainRandomisation(Settings):
    """Ranges from which properties of robot and ground are drawn uniformly at every reset.

    If a field is 0, its property stays unchanged. If `friction` is the range (1, 1), the friction stays unchanged.

    The defaults are close to the ranges of four projects:

    - MuJoCo Playground (Go1): friction 0.4 to 1, trunk mass ± 1 of 5 kg, centre of mass ± 0.05 m.
    - legged_gym (`domain_rand`): friction_range 0.5 to 1.25, added_mass_range ± 1 kg.
    - Isaac Lab (velocity tasks): centre of mass ± 0.05, 0.05 and 0.01 m.
    - Walk These Ways (Margolis and Agrawal, 2022): motor_strength_range 0.9 to 1.1, motor_offset_range ± 0.02 rad.

    Other projects that build on these four usually vary the servo gains by ± 20 %, and use delays up to 20 ms.
    """

    friction: tuple[Positive, Positive] = (0.5, 1.25)
    """Smallest and largest factor on the friction coefficient of all contacts with the ground"""
    trunk_mass: LargeFraction = 0.2
    """Largest change of the trunk mass, as a fraction of the nominal mass; the inertia changes in proportion"""
    centre_of_mass: tuple[NonNegative, NonNegative, NonNegative] = (0.05, 0.05, 0.01)
    """Largest displacement of the trunk's centre of mass along ±x, ±y and ±z of the base frame, m"""
    stiffness: LargeFraction = 0.2
    """Largest change of the stiffness of each joint servo, as a fraction of the nominal stiffness"""
    damping: LargeFraction = 0.2
    """Largest change of the damping of each joint servo, as a fraction of the nominal damping"""
    motor_strength: LargeFraction = 0.1
    """Largest change of the torque limit of each joint servo, as a fraction of the nominal limit.

    If the motors have a torque-speed curve, the limit of the motor current is changed instead of the torque limit.
    """
    delay: Delay = 0.02
    """Largest delay of the joint targets from the policy to the servos, s; the smallest delay is 0.

    The drawn delay is rounded to control steps, and added to the action delay of the scenario (`Latency.action`).
    """
    encoder_offset: NonNegative = 0.02
    """Largest offset of the readings of each joint encoder, rad; servos and rewards use the true angles"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction[0] > self.friction[1]:
            raise ValueError(f"the range of friction must rise, got {self.friction}")

    def draw(self, joints: int, stream: np.random.Generator) -> RandomizationSample:
        """Draw the randomised properties of an episode.

        The number of drawn random numbers does not depend on the ranges. Therefore a change of one range does not
        change the draws of the other properties.

        Args:
            joints: Number of joints.
            stream: Random stream of the episode.

        Returns:
            Randomised properties of robot and ground in the episode.
        """
        friction, mass, delay, *centre = stream.uniform(-1, 1, 6).tolist()
        stiffness, damping, strength, offset = stream.uniform(-1, 1, (4, joints))
        low, high = self.friction
        return RandomizationSample(
            friction=low + (high - low) * 0.5 * (1.0 + friction),
            trunk_mass=1.0 + self.trunk_mass * mass,
            centre_of_mass=np.multiply(self.centre_of_mass, centre),
            stiffness=1.0 + self.stiffness * stiffness,
            damping=1.0 + self.damping * damping,
            motor_strength=1.0 + self.motor_strength * strength,
            delay=self.delay * 0.5 * (1.0 + delay),
            encoder_offset=self.encoder_offset * offset,
        )
