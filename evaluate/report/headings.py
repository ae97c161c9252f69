"""Column headings of tables, and the format of effort measures.

A heading belongs to a column name; table rows use the same column names as keys.
"""

import math

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.pareto import COST_SCENARIOS
from evaluate.measures.catalogue import BY_NAME, EFFORT
from quad_env.cli.format import Estimate, estimate

ROW_LABEL = ""
"""Name of the first column, which holds the label of each row.

It is empty so that it cannot be equal to the name of a policy, which is the name of a column in some tables.
"""
TITLES = {SUCCESS_RATE: "success", FALL_RATE: "falls"} | {name: BY_NAME[name].title for name in ERRORS}
"""Metric -> its title."""
TERMINAL_TITLES = TITLES | {
    "velocity_error": "velocity\nerror m/s",
    "yaw_rate_error": "yaw-rate\nerror rad/s",
    "mean_velocity_error": "mean vel.\nerror m/s",
}
"""Metric -> its title in a table that fits into a terminal of 80 columns."""
TERMINAL_DIFFERENCE_TITLES = TERMINAL_TITLES | {rate: f"{TITLES[rate]}\n% points" for rate in RATES}
"""Metric -> heading of a column of differences on a terminal."""
_PLACES = "at a steady 0.5 m/s", "over the commands"
"""Descriptions of the scenarios on which effort is reported, without the hardware profile."""
EFFORT_SCENARIOS = dict(
    zip(COST_SCENARIOS, (*_PLACES, *(f"{words}, hardware profile" for words in _PLACES)), strict=True)
)
"""Scenario on which effort is reported -> its description."""
EFFORT_TITLES = {name: (BY_NAME[name].title, BY_NAME[name].unit) for name in EFFORT} | {
    name: (BY_NAME[name].title, "%") for name in ("trunk_height", "torque_share", "speed_share", "flight")
}
"""Effort measure -> its title and unit."""
MAIN_EFFORT_TITLES = {"cost_of_transport": "cost of\ntransport", "step_rate": "steps\n1/s", "flight": "flight\n%"}
"""Effort measure -> its heading on a terminal, for the three main ones."""
_DIGITS = {"torque_rate": 0, "touchdown_impulse": 3}
"""Effort measure -> number of decimals, if different from 2."""


def format_effort(name: str, value: float) -> str:
    """Format the `value` of the effort measure `name`, without unit and interval."""
    return estimate_effort(name, value, (math.nan, math.nan)).value


def estimate_effort(name: str, value: float, ends: tuple[float, float]) -> Estimate:
    """Format an effort measure with its interval.

    Args:
        name: Name of the effort measure.
        value: Value; 1 is displayed as 100 if the unit is %.
        ends: Lower and upper end of the interval, in the same unit as `value`.

    Returns:
        The text of value and interval.
    """
    scale, digits = _scale(name)
    return estimate(value, ends, digits, scale)


def _scale(name: str) -> tuple[float, int]:
    """Return the factor from an effort measure to its displayed value, and the number of decimals."""
    is_percent = EFFORT_TITLES[name][1] == "%"
    return (100.0, 1) if is_percent else (1.0, _DIGITS.get(name, 2))
