"""Scenarios of a run, grouped by disturbance axis and sorted by severity.

A disturbance axis is a kind of disturbance, for example pushes. A level is a scenario with one severity of its axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.cells import PolicyScenarioResult
from quad_env.cli.format import NO_BREAK
from quad_env.scenarios.axes import known_axis
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class SeverityAxis:
    """Scenarios of one disturbance axis, sorted from the mildest to the hardest; made by `severity_axes`.

    A scenario that belongs to no disturbance axis forms an axis on its own. Scenarios with the hardware profile and
    scenarios without the profile form two axes with different names.
    """

    name: str
    """Name of the disturbance axis, from `axis_name`."""
    unit: str
    """Unit of the severities, for example `N·s`; empty if the severities have no unit."""
    scenarios: tuple[Scenario, ...]
    """Scenarios of the axis, the mildest first."""

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """Names of the scenarios of the axis, the mildest first."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """Scenarios of the axis with one scenario for each severity, the mildest first.

        Two scenarios of an axis can have the same severity, because the nominal scenario may repeat a level.
        """
        return tuple({scenario.severity: scenario for scenario in reversed(self.scenarios)}.values())[::-1]

    @property
    def quantity(self) -> str:
        """Name and unit of the physical quantity that the severity measures, for axis labels and headings."""
        axis = self.scenarios[0].axis
        named = known.quantity if (known := known_axis(axis)) is not None else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def note(self) -> str:
        """Note for the reader on influences other than the policy on the results of this axis; empty if none."""
        return "" if (known := known_axis(self.name)) is None else known.note

    @property
    def is_harder_when_smaller(self) -> bool:
        """True if a smaller severity makes the scenario harder, for example a smaller friction coefficient."""
        return self.scenarios[0].severity > self.scenarios[-1].severity


def severity_axes(cells: Sequence[PolicyScenarioResult]) -> tuple[SeverityAxis, ...]:
    """Group the scenarios of the results `cells` by disturbance axis, in the order of the run."""
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    for scenario in scenarios.values():
        groups.setdefault(axis_name(scenario), []).append(scenario)
    return tuple(
        SeverityAxis(name, group[0].severity_unit, tuple(_mildest_first(group))) for name, group in groups.items()
    )


def axis_name(scenario: Scenario) -> str:
    """Return the name of the disturbance axis of a scenario, for example `push`.

    It is `push+hardware` for a scenario with the hardware profile. It is the scenario's name if the scenario belongs to
    no axis.
    """
    return scenario.axis + scenario.suffix if scenario.axis else scenario.name


def _mildest_first(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Sort the scenarios of one disturbance axis from the mildest to the hardest.

    For an axis of this project, the order of its defined levels shows whether a larger severity is harder. For any
    other axis, the order of the scenarios in the run shows it.
    """
    axis = scenarios[0].axis
    known = known_axis(axis)
    levels = [scenario.severity for scenario in scenarios] if known is None else known.levels
    return sorted(scenarios, key=lambda scenario: scenario.severity, reverse=levels[0] > levels[-1])


def format_amount(value: float, unit: str = "") -> str:
    """Format the number `value` with its `unit`, for example `35 N·s` or `10°`; `unit` may be empty."""
    return f"{value:.4g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def format_severity(scenario: Scenario) -> str:
    """Format the severity of a scenario, for example `35 N·s`; its name if the severity is 0."""
    return format_amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def format_scenario(scenario: Scenario) -> str:
    """Format disturbance axis and severity of a scenario, for example `push at 35 N·s`.

    The text is the scenario's name if the severity is 0.
    """
    return f"{axis_name(scenario)} at {format_severity(scenario)}" if scenario.severity else scenario.name
