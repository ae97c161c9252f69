"""Column headings of tables, and the format of effort measures.

A heading belongs to a column name; table rows use the same column names as keys.
"""

import math

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.pareto import COST_SCENARIOS
from evaluate.measures.catalogue import BY_NAME, EFFORT
from quad_env.cli.format import Estimate, estimate

ROW_LABEL = ""
"""Name of the first column of a table, which contains the label of each row.

The name is empty, because in some tables the other columns have names of policies, and a policy name is never empty.
"""
TITLES = {SUCCESS_RATE: "success", FALL_RATE: "falls"} | {name: BY_NAME[name].title for name in ERRORS}
"""Name of a metric -> its title in tables and plots."""
TERMINAL_TITLES = TITLES | {
    "velocity_error": "velocity\nerror m/s",
    "yaw_rate_error": "yaw-rate\nerror rad/s",
    "mean_velocity_error": "mean vel.\nerror m/s",
}
"""Name of a metric -> its short title, so that a table fits into a terminal with 80 characters per line."""
TERMINAL_DIFFERENCE_TITLES = TERMINAL_TITLES | {rate: f"{TITLES[rate]}\n% points" for rate in RATES}
"""Name of a metric -> heading of the column with differences of this metric, in tables on a terminal."""
_PLACES = "at a steady 0.5 m/s", "over the commands"
"""Descriptions of the two scenarios without the hardware profile on which motor effort is reported."""
EFFORT_SCENARIOS = dict(
    zip(COST_SCENARIOS, (*_PLACES, *(f"{words}, hardware profile" for words in _PLACES)), strict=True)
)
"""Name of a scenario on which motor effort is reported -> its description in tables."""
EFFORT_TITLES = {name: (BY_NAME[name].title, BY_NAME[name].unit) for name in EFFORT} | {
    name: (BY_NAME[name].title, "%") for name in ("trunk_height", "torque_share", "speed_share", "flight")
}
"""Name of an effort measure -> its title and the unit in which tables show it."""
MAIN_EFFORT_TITLES = {"cost_of_transport": "cost of\ntransport", "step_rate": "steps\n1/s", "flight": "flight\n%"}
"""Name of each of the three main effort measures -> heading of its column on a terminal."""
_DIGITS = {"torque_rate": 0, "touchdown_impulse": 3}
"""Name of an effort measure -> number of decimals in tables; measures that are missing here have 2."""


def format_effort(name: str, value: float) -> str:
    """Format the `value` of the effort measure `name` as text; the unit and the interval are left out."""
    return estimate_effort(name, value, (math.nan, math.nan)).value


def estimate_effort(name: str, value: float, ends: tuple[float, float]) -> Estimate:
    """Format the value of an effort measure with its interval.

    Args:
        name: Name of the effort measure.
        value: Value of the measure; if tables show the measure in %, the value 1 is displayed as 100.
        ends: Lower and upper end of the interval, in the same unit as `value`.

    Returns:
        Texts of the value and of the interval.
    """
    scale, digits = _scale(name)
    return estimate(value, ends, digits, scale)


def _scale(name: str) -> tuple[float, int]:
    """Return the factor from the effort measure `name` to its displayed value, and its number of decimals."""
    is_percent = EFFORT_TITLES[name][1] == "%"
    return (100.0, 1) if is_percent else (1.0, _DIGITS.get(name, 2))
