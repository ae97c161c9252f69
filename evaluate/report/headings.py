"""Headings of tables, by the names of columns that rows use as well."""

import math

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.pareto import COST_SCENARIOS
from evaluate.measures.catalogue import BY_NAME, EFFORT
from quad_env.cli.format import Estimate, estimate

ROW_LABEL = ""
"""Name of the column with the label of a row, in tables with user-named other columns."""
TITLES = {SUCCESS_RATE: "success", FALL_RATE: "falls"} | {name: BY_NAME[name].title for name in ERRORS}
"""Metric -> title."""
TERMINAL_TITLES = TITLES | {
    "velocity_error": "velocity\nerror m/s",
    "yaw_rate_error": "yaw-rate\nerror rad/s",
    "mean_velocity_error": "mean vel.\nerror m/s",
}
"""Metric -> title that fits into a terminal of 80 columns."""
TERMINAL_DIFFERENCE_TITLES = TERMINAL_TITLES | {rate: f"{TITLES[rate]}\n% points" for rate in RATES}
"""Metric -> title of a column of differences on a terminal."""
_PLACES = "at a steady 0.5 m/s", "over the commands"
"""Descriptions of the scenarios for effort."""
EFFORT_SCENARIOS = dict(
    zip(COST_SCENARIOS, (*_PLACES, *(f"{words}, hardware profile" for words in _PLACES)), strict=True)
)
"""Scenario for the figures of effort -> its description."""
EFFORT_TITLES = {name: (BY_NAME[name].title, BY_NAME[name].unit) for name in EFFORT} | {
    name: (BY_NAME[name].title, "%") for name in ("trunk_height", "torque_share", "speed_share", "flight")
}
"""Figure of effort -> title and unit."""
MAIN_EFFORT_TITLES = {"cost_of_transport": "cost of\ntransport", "step_rate": "steps\n1/s", "flight": "flight\n%"}
"""The three main figures of effort -> heading on a terminal."""
_DIGITS = {"torque_rate": 0, "touchdown_impulse": 3}
"""Figure of effort -> decimals, if not 2."""


def format_effort(name: str, value: float) -> str:
    """Format the figure of effort `name` with that `value`, without unit and interval."""
    return estimate_effort(name, value, (math.nan, math.nan)).value


def estimate_effort(name: str, value: float, ends: tuple[float, float]) -> Estimate:
    """Format a figure of effort with its interval, in one unit.

    Args:
        name: Name of the figure of effort.
        value: Value; a proportion of 1 for per cent.
        ends: Lower and upper end of its interval, as `value`.

    Returns:
        The text of figure and interval.
    """
    scale, digits = _scale(name)
    return estimate(value, ends, digits, scale)


def _scale(name: str) -> tuple[float, int]:
    """Return the factor of a figure's unit, and its decimals."""
    is_percent = EFFORT_TITLES[name][1] == "%"
    return (100.0, 1) if is_percent else (1.0, _DIGITS.get(name, 2))
