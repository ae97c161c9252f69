"""What is filmed, and how."""

from dataclasses import dataclass

from evaluate.film.captions import SMALLEST
from evaluate.rollouts.experiment import LabelledPolicy
from evaluate.rollouts.hardware import IDEAL, Hardware
from policies.base import CONTROL_PERIOD
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Take:
    """What is filmed: policies, side by side, in the same episode of a scenario."""

    policies: tuple[LabelledPolicy, ...]
    scenario: Scenario
    seed: int
    steps: int
    title: str
    hardware: Hardware = IDEAL
    command: tuple[float, float, float] | None = None
    """Held for the whole episode; None: the scenario draws commands."""


@dataclass(frozen=True)
class Look:
    """How it is filmed."""

    size: tuple[int, int] = (640, 480)
    """Width and height of each robot's frames, pixels."""
    camera: str = "track"
    speed: float = 1.0
    """1 is real time, less is slow motion."""
    rate: float = 25.0
    """Frames a second, about: a whole number of control steps lies between two."""
    ghost: bool = True
    """Whether ghost and arrows are drawn."""

    @property
    def every(self) -> int:
        """Control steps from a frame to the next."""
        return max(1, round(self.speed / (self.rate * CONTROL_PERIOD)))

    @property
    def period(self) -> float:
        """Time for which a frame is shown, s."""
        return self.every * CONTROL_PERIOD / self.speed

    @property
    def letters(self) -> int:
        """Size of the captions' letters, pixels."""
        return max(SMALLEST, min(self.size) // 30)
