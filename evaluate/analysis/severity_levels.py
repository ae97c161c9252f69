"""Scenarios of a run, grouped by axis and sorted by severity.

An axis is a kind of disturbance. A level is a scenario with one severity of its axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.cells import PolicyScenarioResult
from quad_env.cli.format import NO_BREAK
from quad_env.scenarios.axes import known_axis
from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class SeverityAxis:
    """Scenarios of one axis, from the mildest to the hardest; made by `severity_axes`.

    A scenario that belongs to no axis forms an axis of its own. Scenarios with the hardware profile and scenarios
    without the profile form two axes with different names.
    """

    name: str
    """Name of the axis, from `axis_name`."""
    unit: str
    """Unit of the severities; empty if they have none."""
    scenarios: tuple[Scenario, ...]
    """Scenarios, the mildest first."""

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """Names of the scenarios."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """One scenario for each severity, the mildest first.

        Two scenarios can have the same severity, because the nominal scenario may repeat a level.
        """
        return tuple({scenario.severity: scenario for scenario in reversed(self.scenarios)}.values())[::-1]

    @property
    def quantity(self) -> str:
        """Name and unit of the quantity that the severity measures."""
        axis = self.scenarios[0].axis
        named = known.quantity if (known := known_axis(axis)) is not None else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def note(self) -> str:
        """Note on factors other than the policy that affect results on this axis; empty if there are none."""
        return "" if (known := known_axis(self.name)) is None else known.note

    @property
    def is_harder_when_smaller(self) -> bool:
        """True if a smaller severity is harder, for example a smaller friction."""
        return self.scenarios[0].severity > self.scenarios[-1].severity


def severity_axes(cells: Sequence[PolicyScenarioResult]) -> tuple[SeverityAxis, ...]:
    """Group the scenarios of `cells` by axis, in the order of the first scenario of each axis."""
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    for scenario in scenarios.values():
        groups.setdefault(axis_name(scenario), []).append(scenario)
    return tuple(
        SeverityAxis(name, group[0].severity_unit, tuple(_mildest_first(group))) for name, group in groups.items()
    )


def axis_name(scenario: Scenario) -> str:
    """Return the name of a scenario's axis: `push`, or `push+hardware` with the hardware profile.

    A scenario that belongs to no axis returns its own name.
    """
    return scenario.axis + scenario.suffix if scenario.axis else scenario.name


def _mildest_first(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Sort the scenarios of one axis from the mildest to the hardest.

    For a known axis, the order of its levels shows whether a larger severity is harder. For any other axis, the order
    of the scenarios in the run shows it.
    """
    axis = scenarios[0].axis
    known = known_axis(axis)
    levels = [scenario.severity for scenario in scenarios] if known is None else known.levels
    return sorted(scenarios, key=lambda scenario: scenario.severity, reverse=levels[0] > levels[-1])


def format_amount(value: float, unit: str = "") -> str:
    """Format a `value` with its `unit`, for example `35 N·s` or `10°`; only the number if `unit` is empty."""
    return f"{value:.4g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def format_severity(scenario: Scenario) -> str:
    """Format the severity of a scenario, for example `35 N·s`; the scenario's name if the severity is 0."""
    return format_amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def format_scenario(scenario: Scenario) -> str:
    """Format axis and severity of a scenario, for example `push at 35 N·s`; its name if the severity is 0."""
    return f"{axis_name(scenario)} at {format_severity(scenario)}" if scenario.severity else scenario.name
