"""Scenarios: what a robot has to cope with, as values in physical units.

A scenario is never tuned to a policy. Write one with `dataclasses.replace` or the constructor and pass it to `make`.
"""

from dataclasses import dataclass, field

from quad_env.config import CommandRanges, StartNoise
from quad_env.terrain import Flat, SmoothRandom, Terrain


@dataclass(frozen=True)
class Pushes:
    """Horizontal forces on the trunk's centre, at random times, in random world directions.

    The window is cut into `count` equal parts with one push in each, so that pushes never overlap.
    """

    count: int = 2
    impulse: float = 35.0
    """N·s each"""
    duration: float = 0.1
    """s"""
    window: tuple[float, float] = (1.0, 9.0)
    """s from the start of the episode within which every push lies"""

    def __post_init__(self) -> None:
        start, end = self.window
        if self.count < 0 or self.duration <= 0 or self.count * self.duration > end - start:
            raise ValueError(f"{self.count} pushes of {self.duration} s do not fit into the window {self.window} s")


@dataclass(frozen=True)
class Scenario:
    """Terrain, disturbances, commands and start of an episode."""

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise = field(default_factory=StartNoise)
    severity: float = 0.0
    """Of the scenario's own axis, in the unit of `severity_unit`; 0 where nothing disturbs."""
    severity_unit: str = ""
    axis: str = ""
    """Of `quad_env.axes`, where the scenario is a severity of one."""


SCENARIOS: dict[str, Scenario] = {
    "flat": Scenario("flat", axis="flat"),
    "push": Scenario("push", pushes=Pushes(), severity=35.0, severity_unit="N·s", axis="push"),
    "rough": Scenario("rough", terrain=SmoothRandom(), severity=0.12, severity_unit="m", axis="rough"),
}


def scenario(which: str | Scenario) -> Scenario:
    """The scenario of that name, or the scenario itself; ValueError lists the valid names."""
    if isinstance(which, Scenario):
        return which
    if not isinstance(which, str) or which not in SCENARIOS:
        raise ValueError(f"unknown scenario {which!r}; valid: {', '.join(SCENARIOS)}, or a quad_env.Scenario")
    return SCENARIOS[which]
