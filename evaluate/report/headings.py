"""Headings of tables: a table's headings and the cells of its rows are kept by the same names of columns."""

from evaluate.analysis.comparison import ERRORS, FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.summary import Summary
from evaluate.measures.catalogue import BY_NAME
from quad_env.cli.format import NO_BREAK, number

FIRST = ""
"""Name of the column that says what a row is of, in tables whose other columns are named by the user."""
TITLES = {SUCCESS_RATE: "success", FALL_RATE: "falls"} | {name: BY_NAME[name].title for name in ERRORS}
UNITS = dict.fromkeys(RATES, "") | {name: BY_NAME[name].unit for name in ERRORS}
DIFFERENCE_UNITS = UNITS | dict.fromkeys(RATES, "% points")
"""Titles and units by the METRICS."""
NARROW = TITLES | {
    "velocity_error": "velocity\nerror m/s",
    "yaw_rate_error": "yaw-rate\nerror rad/s",
    "mean_velocity_error": "mean vel.\nerror m/s",
}
"""On a terminal of 80 columns."""
NARROW_DIFFERENCES = NARROW | {rate: f"{TITLES[rate]}\n% points" for rate in RATES}
"""Of differences."""


def shares(summary: Summary) -> str:
    """Successes, and in brackets falls, in per cent."""
    return f"{number(100.0 * summary.success_rate, 0)}{NO_BREAK}({number(100.0 * summary.fall_rate, 0)})"
