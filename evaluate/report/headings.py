"""Headings of tables: a table's headings and the cells of its rows are kept by the same names of columns."""

import math

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.pareto import COST_SCENARIOS
from evaluate.measures.catalogue import BY_NAME, EFFORT
from quad_env.cli.format import Estimate, estimate

FIRST = ""
"""Name of the column that says what a row is of, in tables whose other columns are named by the user."""
TITLES = {SUCCESS_RATE: "success", FALL_RATE: "falls"} | {name: BY_NAME[name].title for name in ERRORS}
"""Titles by the METRICS."""
NARROW = TITLES | {
    "velocity_error": "velocity\nerror m/s",
    "yaw_rate_error": "yaw-rate\nerror rad/s",
    "mean_velocity_error": "mean vel.\nerror m/s",
}
"""On a terminal of 80 columns."""
NARROW_DIFFERENCES = NARROW | {rate: f"{TITLES[rate]}\n% points" for rate in RATES}
"""Of differences."""
_PLACES = "at a steady 0.5 m/s", "over the commands"
EFFORT_ON = dict(zip(COST_SCENARIOS, (*_PLACES, *(f"{words}, hardware profile" for words in _PLACES)), strict=True))
"""Scenarios of which effort is shown."""
EFFORT_TITLES = {name: (BY_NAME[name].title, BY_NAME[name].unit) for name in EFFORT} | {
    name: (BY_NAME[name].title, "%") for name in ("trunk_height", "torque_share", "speed_share", "flight")
}
"""Titles and units of the figures of effort."""
FEW = {"cost_of_transport": "cost of\ntransport", "step_rate": "steps\n1/s", "flight": "flight\n%"}
"""Figures of effort where there is room for three, with their headings on a terminal."""
_DIGITS = {"torque_rate": 0, "touchdown_impulse": 3}


def figure_of_effort(name: str, value: float) -> str:
    """Format the figure without its unit and its interval."""
    return effort_with(name, value, (math.nan, math.nan)).value


def effort_with(name: str, value: float, ends: tuple[float, float]) -> Estimate:
    """Format the figure with its interval, in one unit.

    Args:
        name: Of the figure of effort.
        value: Its value; a share of 1 for per cent.
        ends: Lower and upper end of its interval, as `value`.
    """
    scale, digits = _scale(name)
    return estimate(value, ends, digits, scale)


def _scale(name: str) -> tuple[float, int]:
    """Factor of its unit, and decimals."""
    percent = EFFORT_TITLES[name][1] == "%"
    return (100.0, 1) if percent else (1.0, _DIGITS.get(name, 2))
