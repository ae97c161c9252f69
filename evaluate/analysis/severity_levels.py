"""Axes of a run: its scenarios, grouped by axis and ordered by severity."""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.cells import PolicyScenarioResult
from quad_env.cli.format import NO_BREAK
from quad_env.scenarios.axes import known_axis
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class SeverityAxis:
    """Scenarios of one axis, from the mildest to the hardest; made by `severity_axes`.

    A scenario without an axis is an axis of its own. Scenarios with and without the hardware profile form two axes with
    different names.
    """

    name: str
    """Name from `axis_name`."""
    unit: str
    """Unit of the severities; may be empty."""
    scenarios: tuple[Scenario, ...]
    """Scenarios, the mildest first."""

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """Names of the scenarios."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """One scenario of each severity; the nominal one may repeat a level."""
        return tuple({scenario.severity: scenario for scenario in reversed(self.scenarios)}.values())[::-1]

    @property
    def quantity(self) -> str:
        """Quantity of the severity, with its unit."""
        axis = self.scenarios[0].axis
        named = known.quantity if (known := known_axis(axis)) is not None else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def note(self) -> str:
        """Other dependencies of the results besides the policy; empty without any."""
        return "" if (known := known_axis(self.name)) is None else known.note

    @property
    def is_harder_when_smaller(self) -> bool:
        """True if a smaller severity is harder, as for friction."""
        return self.scenarios[0].severity > self.scenarios[-1].severity


def severity_axes(cells: Sequence[PolicyScenarioResult]) -> tuple[SeverityAxis, ...]:
    """Group the scenarios of a run's cells by axis, in their order."""
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    for scenario in scenarios.values():
        groups.setdefault(axis_name(scenario), []).append(scenario)
    return tuple(
        SeverityAxis(name, group[0].severity_unit, tuple(_mildest_first(group))) for name, group in groups.items()
    )


def axis_name(scenario: Scenario) -> str:
    """Return `push`, or `push+hardware` with the hardware profile; the scenario's name if it has no axis."""
    return scenario.axis + scenario.suffix if scenario.axis else scenario.name


def _mildest_first(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Sort the scenarios of one axis by difficulty.

    An axis that is not in `AXES` gets harder in the order of the run.
    """
    axis = scenarios[0].axis
    known = known_axis(axis)
    levels = [scenario.severity for scenario in scenarios] if known is None else known.levels
    return sorted(scenarios, key=lambda scenario: scenario.severity, reverse=levels[0] > levels[-1])


def format_amount(value: float, unit: str = "") -> str:
    """Format a `value` with its `unit`: `35 N·s`, `10°`, or a number alone."""
    return f"{value:.4g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def format_severity(scenario: Scenario) -> str:
    """Format the severity, `35 N·s`; the scenario's name if it has none."""
    return format_amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def format_scenario(scenario: Scenario) -> str:
    """Format axis and severity, `push at 35 N·s`; the scenario's name if it has no severity."""
    return f"{axis_name(scenario)} at {format_severity(scenario)}" if scenario.severity else scenario.name
