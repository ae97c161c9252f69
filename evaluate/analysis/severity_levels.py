"""Ladders: the scenarios of a run, grouped by the axis that they are levels of."""

from dataclasses import dataclass

from evaluate.analysis.results import Results
from evaluate.terminal.format import NO_BREAK
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.named import Scenario


@dataclass(frozen=True)
class Ladder:
    """Scenarios of one axis, from the mildest to the hardest; a scenario without an axis stands alone."""

    name: str
    unit: str
    rungs: tuple[Scenario, ...]

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the rungs."""
        return tuple(rung.name for rung in self.rungs)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """The rungs, one of each severity: the nominal scenario may repeat a level."""
        return tuple({rung.severity: rung for rung in reversed(self.rungs)}.values())[::-1]

    @property
    def nominal(self) -> Scenario:
        """The rung of the axis's nominal severity, else the mildest."""
        wanted = AXES[self.name].nominal if self.name in AXES else self.rungs[0].severity
        return next((rung for rung in self.rungs if rung.severity == wanted), self.rungs[0])

    @property
    def quantity(self) -> str:
        """What its severity is, with its unit."""
        named = AXES[self.name].quantity if self.name in AXES else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def falling(self) -> bool:
        """Whether a smaller severity is harder, as with friction."""
        return falling(self.name)


def ladders(results: Results) -> tuple[Ladder, ...]:
    """Every axis of the run, in its order."""
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in results.cells}
    for scenario in scenarios.values():
        groups.setdefault(scenario.axis or scenario.name, []).append(scenario)
    return tuple(
        Ladder(name, rungs[0].severity_unit, tuple(sorted(rungs, key=lambda rung: _hardness(name, rung))))
        for name, rungs in groups.items()
    )


def falling(axis: str) -> bool:
    """Whether an axis gets harder as its severity falls."""
    return axis in AXES and AXES[axis].falling


def amount(value: float, unit: str) -> str:
    """`35 N·s`, `10°`, or a bare number."""
    return f"{value:g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def severity(scenario: Scenario) -> str:
    """`35 N·s`, or the scenario's name where it has no severity."""
    return amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def place(scenario: Scenario) -> str:
    """`push at 35 N·s`, or the scenario's name where it has no severity."""
    return f"{scenario.axis} at {severity(scenario)}" if scenario.severity else scenario.name


def _hardness(axis: str, scenario: Scenario) -> float:
    return -scenario.severity if falling(axis) else scenario.severity
