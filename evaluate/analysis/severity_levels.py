"""The axes of a run: its scenarios, grouped by what they are levels of."""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.cells import PolicyScenarioResult
from quad_env.cli.format import NO_BREAK
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class SeverityAxis:
    """Scenarios of one axis, from the mildest to the hardest; a scenario without an axis stands alone.

    With the hardware profile and without it they are two axes, with different names.
    """

    name: str
    """As of `axis_name`."""
    unit: str
    scenarios: tuple[Scenario, ...]

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """Names of the scenarios."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """One scenario of each severity: the nominal one may repeat a level."""
        return tuple({scenario.severity: scenario for scenario in reversed(self.scenarios)}.values())[::-1]

    @property
    def quantity(self) -> str:
        """What its severity is, with its unit."""
        axis = self.scenarios[0].axis
        named = AXES[axis].quantity if axis in AXES else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def note(self) -> str:
        """What its results depend on besides the policy; empty where nothing is said."""
        return AXES[self.name].note if self.name in AXES else ""

    @property
    def harder_when_smaller(self) -> bool:
        """Whether a smaller severity is harder, as with friction."""
        return self.scenarios[0].severity > self.scenarios[-1].severity


def severity_axes(cells: Sequence[PolicyScenarioResult]) -> tuple[SeverityAxis, ...]:
    """Every axis of a run's cells, in their order."""
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    for scenario in scenarios.values():
        groups.setdefault(axis_name(scenario), []).append(scenario)
    return tuple(
        SeverityAxis(name, group[0].severity_unit, tuple(_mildest_first(group))) for name, group in groups.items()
    )


def axis_name(scenario: Scenario) -> str:
    """`push`, with the hardware profile `push+hardware`; of a scenario without an axis its own name."""
    return scenario.axis + scenario.suffix if scenario.axis else scenario.name


def _mildest_first(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Scenarios of one axis in the order of their hardness; an axis that is not of `AXES` hardens as it is run."""
    axis = scenarios[0].axis
    levels = AXES[axis].levels if axis in AXES else [each.severity for each in scenarios]
    return sorted(scenarios, key=lambda each: each.severity, reverse=levels[0] > levels[-1])


def amount(value: float, unit: str = "") -> str:
    """`35 N·s`, `10°`, or a bare number."""
    return f"{value:.4g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def severity(scenario: Scenario) -> str:
    """`35 N·s`, or the scenario's name where it has no severity."""
    return amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def place(scenario: Scenario) -> str:
    """`push at 35 N·s`, or the scenario's name where it has no severity."""
    return f"{axis_name(scenario)} at {severity(scenario)}" if scenario.severity else scenario.name
