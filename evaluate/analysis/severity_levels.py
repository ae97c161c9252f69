"""Scenarios of an evaluation, grouped by disturbance axis and sorted by severity.

A disturbance axis is a kind of disturbance, for example pushes, that is tested at several severities. Each severity has
a scenario.
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

    A disturbance axis is a kind of disturbance, for example pushes, that is tested at several severities. A scenario
    that belongs to no disturbance axis forms an axis on its own. Scenarios with the hardware profile (models of the
    real robot's motors and sensors) form an axis of their own.
    """

    name: str
    """Name of the disturbance axis, for example `push`, or `push+hardware` with the hardware profile."""
    unit: str
    """Unit of the severities on this disturbance axis, for example `N·s`; empty if the severities have none."""
    scenarios: tuple[Scenario, ...]
    """All scenarios of the disturbance axis in the evaluation, the mildest first."""

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """Names of all scenarios of the disturbance axis, the mildest first."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def levels(self) -> tuple[Scenario, ...]:
        """Scenarios of the disturbance axis, exactly one for each severity, the mildest first.

        If two scenarios have the same severity, only the first of them is included. For example, `push` has the same
        severity as one of the numbered scenarios `push:1`, `push:2`, ….
        """
        return tuple({scenario.severity: scenario for scenario in reversed(self.scenarios)}.values())[::-1]

    @property
    def quantity(self) -> str:
        """Name and unit of the physical quantity that the severity measures, for plot labels and headings."""
        axis = self.scenarios[0].axis
        named = known.quantity if (known := known_axis(axis)) is not None else self.name
        return f"{named}, {self.unit}" if self.unit else named

    @property
    def note(self) -> str:
        """Note in the report on influences other than the policy on this axis's results; empty if none."""
        return "" if (known := known_axis(self.name)) is None else known.note

    @property
    def is_harder_when_smaller(self) -> bool:
        """True if a smaller severity makes the scenarios of this axis harder, as a friction coefficient does."""
        return self.scenarios[0].severity > self.scenarios[-1].severity


def severity_axes(cells: Sequence[PolicyScenarioResult]) -> tuple[SeverityAxis, ...]:
    """Group the scenarios of an evaluation by disturbance axis.

    A disturbance axis is a kind of disturbance with several severities.

    Args:
        cells: Measured episodes of the evaluation, one result for each policy-scenario pair.

    Returns:
        Disturbance axes in the order of the evaluation, each with its scenarios from the mildest to the hardest.
    """
    groups: dict[str, list[Scenario]] = {}
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    for scenario in scenarios.values():
        groups.setdefault(axis_name(scenario), []).append(scenario)
    return tuple(
        SeverityAxis(name, group[0].severity_unit, tuple(_mildest_first(group))) for name, group in groups.items()
    )


def axis_name(scenario: Scenario) -> str:
    """Return the name of the disturbance axis of a scenario, for example `push`.

    The name is `push+hardware` for a scenario with the hardware profile (models of the real robot's motors and
    sensors). It is the name of the scenario if the scenario belongs to no disturbance axis.
    """
    return scenario.axis + scenario.suffix if scenario.axis else scenario.name


def _mildest_first(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """Sort the scenarios of one disturbance axis from the mildest to the hardest.

    The definition of the axis lists its severities from the mildest to the hardest. The order shows if a larger
    severity is harder. If the axis is not registered, the order of `scenarios` is used instead.

    Args:
        scenarios: Scenarios of one disturbance axis, in the order of the evaluation.

    Returns:
        The scenarios, the mildest first.
    """
    axis = scenarios[0].axis
    known = known_axis(axis)
    levels = [scenario.severity for scenario in scenarios] if known is None else known.levels
    return sorted(scenarios, key=lambda scenario: scenario.severity, reverse=levels[0] > levels[-1])


def format_amount(value: float, unit: str = "") -> str:
    """Format the number `value`, four digits, with its `unit`, such as `35 N·s`; `unit` may be empty."""
    return f"{value:.4g}{'' if unit in ('', '°') else NO_BREAK}{unit}"


def format_severity(scenario: Scenario) -> str:
    """Format the severity of a `scenario` as text, for example `35 N·s`.

    The text is the name of the scenario if its severity is 0.
    """
    return format_amount(scenario.severity, scenario.severity_unit) if scenario.severity else scenario.name


def format_scenario(scenario: Scenario) -> str:
    """Format disturbance axis and severity of a `scenario` as text, for example `push at 35 N·s`.

    The text is the name of the scenario if its severity is 0.
    """
    return f"{axis_name(scenario)} at {format_severity(scenario)}" if scenario.severity else scenario.name
