"""Domain randomisation (domain randomization): figures of robot and ground that differ from episode to episode."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from quad_env.columns import Array
from quad_env.config import Bounds, NonNegative, Positive, Settings
from quad_env.scenarios.disturbances import Delay

LargeFraction = Annotated[float, Bounds("from 0 to 0.9", 0.0, 0.9)]


class RandomizationSample(NamedTuple):
    """Figures of one episode: factors, of joints (12,), displacement of the centre of mass, (3,), m, delay, s, and
    offsets, (12,), rad."""

    friction: float
    trunk_mass: float
    centre_of_mass: Array
    stiffness: Array
    damping: Array
    motor_strength: Array
    delay: float
    encoder_offset: Array


@dataclass(frozen=True)
class DomainRandomisation(Settings):
    """What every robot draws uniformly at every reset; 0, for friction (1, 1), leaves a figure as it is.

    The defaults are about those of MuJoCo Playground (Go1: friction 0.4 to 1, trunk ± 1 of 5 kg, centre of mass
    ± 0.05 m), legged_gym (`domain_rand`: friction_range 0.5 to 1.25, added_mass_range ± 1 kg), Isaac Lab (velocity
    tasks: centre of mass ± 0.05, 0.05 and 0.01 m) and Walk These Ways (Margolis and Agrawal, 2022: motor_strength_range
    0.9 to 1.1, motor_offset_range ± 0.02 rad); gains ± 20 % and 20 ms are usual in projects built on these.
    """

    friction: tuple[Positive, Positive] = (0.5, 1.25)
    """Range of the factor on the ground's friction coefficient, which holds for whatever touches the ground"""
    trunk_mass: LargeFraction = 0.2
    """Largest share of the trunk's mass that is added or removed; its inertia goes with it"""
    centre_of_mass: tuple[NonNegative, NonNegative, NonNegative] = (0.05, 0.05, 0.01)
    """m, half-widths along the trunk's axes, forward, to the left and up, of its centre of mass"""
    stiffness: LargeFraction = 0.2
    """Largest share by which the stiffness of each joint's servo is more or less"""
    damping: LargeFraction = 0.2
    """The same of its damping"""
    motor_strength: LargeFraction = 0.1
    """The same of its torque limit; of motors with a torque-speed curve, of the limit of the current"""
    delay: Delay = 0.02
    """s, longest delay of actions, from 0 on, rounded to whole control steps; added to the scenario's `Latency`"""
    encoder_offset: NonNegative = 0.02
    """rad, half-width of what each encoder reads too much; servos and rewards go by the true angles"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction[0] > self.friction[1]:
            raise ValueError(f"the range of friction must rise, got {self.friction}")

    def draw(self, joints: int, stream: np.random.Generator) -> RandomizationSample:
        """Figures of the stream's episode, as many numbers whatever is randomised, so that no figure shifts another."""
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
