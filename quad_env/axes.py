"""Axes of disturbance: one kind of trouble each, as scenarios from harmless to where robots fall.

A severity is in the axis's own physical unit. `push` is the axis at its nominal severity, `push:3` its third level.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from quad_env.scenarios import SCENARIOS, Pushes, Scenario
from quad_env.terrain import SmoothRandom


@dataclass(frozen=True)
class Axis:
    """A scenario for each severity."""

    name: str
    unit: str
    levels: tuple[float, ...]
    """Severities from the mildest to the hardest; where less is harder, as with friction, they fall."""
    at: Callable[[float], Scenario]
    """The scenario of a severity; its name, axis and severity are filled in here."""

    def level(self, number: int) -> Scenario:
        """The scenario of the level of that number, counted from 1; ValueError names the valid ones."""
        if not 1 <= number <= len(self.levels):
            raise ValueError(f"{self.name} has levels 1 to {len(self.levels)}, not {number}")
        return self.scenario(self.levels[number - 1], f"{self.name}:{number}")

    def scenario(self, severity: float, name: str) -> Scenario:
        """The scenario of that severity under that name."""
        return replace(self.at(severity), name=name, axis=self.name, severity=severity, severity_unit=self.unit)


def _push(impulse: float) -> Scenario:
    return replace(SCENARIOS["push"], pushes=Pushes(impulse=impulse))


def _rough(peak_to_valley: float) -> Scenario:
    return replace(SCENARIOS["rough"], terrain=SmoothRandom(peak_to_valley=peak_to_valley))


AXES: dict[str, Axis] = {
    axis.name: axis
    for axis in (
        Axis("push", "N·s", (20.0, 35.0, 50.0, 65.0, 80.0, 100.0), _push),
        Axis("rough", "m", (0.06, 0.12, 0.18, 0.24, 0.32, 0.4), _rough),
    )
}
