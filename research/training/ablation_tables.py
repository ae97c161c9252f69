"""Tables of an ablation study: mean over seeds, and difference from the default, paired by seed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.report.plots import drawing
from evaluate.statistics.intervals import CONFIDENCE, Interval, mean_proportion_interval
from policies.base import Floats
from quad_env.cli.format import estimate
from quad_env.files.writing import write_atomically
from research.pages.evaluations import figure_to_png
from research.pages.markdown import table
from research.training.ablation_groups import DEFAULT, AblationGroup

COLUMNS = {
    "variant": "variant",
    "options": "options",
    "success": "success, %",
    "success_difference": "minus the default's, points",
    "velocity_error": "velocity error, m/s",
    "velocity_error_difference": "minus the default's, m/s",
}
"""Column of the Markdown table -> its heading."""
DIGITS = {"success": 1, "velocity_error": 3}
"""Name of a result, from `read_results`, that is compared with the default -> number of decimals in the table."""


def make_rows(
    group: AblationGroup, robot: str, variants: Mapping[str, Sequence[Mapping[str, float]]]
) -> list[dict[str, Any]]:
    """Make the rows of the table of results of a group on one robot, one row per variant.

    Args:
        group: The group.
        robot: Name of the robot.
        variants: Name of a variant -> results from `read_results` with each seed, in the same order of the seeds.

    Returns:
        Rows: name of the column -> value. For success, %, and velocity error, m/s, a row has the value with each seed,
        the mean, and its 95 % interval over seeds if there is one. Except for the default variant, it also has the mean
        difference from the default with the same seed, and its 95 % interval.
    """
    rows = []
    for name, results in variants.items():
        row: dict[str, Any] = {"robot": robot, "variant": name, "options": group.variants[name].description(group.unit)}
        for result in DIGITS:
            values = _over_seeds(results, result)
            row[f"{result}_by_seed"] = " ".join(f"{value:.6g}" for value in values)
            row[result] = float(values.mean())
            row |= _interval_columns(result, _mean_interval(result, values))
            if name != DEFAULT:
                differences = values - _over_seeds(variants[DEFAULT], result)
                row[f"{result}_difference"] = float(differences.mean())
                row |= _interval_columns(f"{result}_difference", student_interval(differences))
        row["median_minutes"] = float(np.median(_over_seeds(results, "minutes")))
        rows.append(row)
    return rows


def _over_seeds(results: Sequence[Mapping[str, float]], name: str) -> Floats:
    return np.array([result[name] for result in results])


def _interval_columns(name: str, ends: Interval) -> dict[str, float]:
    return dict(zip((f"{name}_low", f"{name}_high"), ends, strict=True))


def _mean_interval(result: str, values: Floats) -> Interval:
    """Return the 95 % interval of the mean of the values with each seed, (seeds,); success is between 0 and 100 %."""
    if result == "success":
        low, high = mean_proportion_interval(values / 100.0)
        return (100.0 * low, 100.0 * high)
    return student_interval(values)


def student_interval(values: Floats) -> Interval:
    """Return the 95 % interval of the mean of n values, (n,), by Student's t.

    A bootstrap interval is not used, because it is too narrow with five seeds. The interval is (NaN, NaN) if all values
    are equal, because these give no estimate of the variance.
    """
    from scipy.stats import ttest_1samp

    if np.ptp(values) == 0.0:
        return (np.nan, np.nan)
    low, high = ttest_1samp(values, 0.0).confidence_interval(CONFIDENCE)
    return (float(low), float(high))


def table_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines of the Markdown table of a group on one robot, from the `rows` of `make_rows`."""
    return table(COLUMNS, [_cells(row) for row in rows]).splitlines()


def _cells(row: Mapping[str, Any]) -> dict[str, str]:
    """Format the row of a table as text."""
    options = f"`{row['options']}`" if row["options"] else ""
    values = {name: _cell(row, name, DIGITS[name.removesuffix("_difference")]) for name in list(COLUMNS)[2:]}
    return {"variant": row["variant"], "options": options, **values}


def _cell(row: Mapping[str, Any], name: str, digits: int) -> str:
    """Format a value of a row with its interval, for example `61.3 [50.2 … 71.4]`; empty if the row has no value."""
    if name not in row:
        return ""
    return estimate(row[name], (row[f"{name}_low"], row[f"{name}_high"]), digits).with_interval


def draw_differences(rows: Sequence[Mapping[str, Any]], picture: Path) -> None:
    """Plot the success rate of each variant minus the success rate of the default, with its 95 % interval.

    Args:
        rows: Rows from `make_rows`.
        picture: PNG file to write.
    """
    rows = [row for row in rows if row["variant"] != DEFAULT]
    left = 0.2 + max(map(drawing.text_width, (row["variant"] for row in rows)), default=0.0)
    with drawing.plot_settings():
        figure, axes = drawing.make_figure(0.6 + 0.2 * len(rows), left + 3.2, drawing.Margins(left=left))
        for line, row in enumerate(rows):
            ends = (row["success_difference_low"], row["success_difference_high"])
            if not np.isnan(ends).any():
                axes.plot(ends, (line, line), color=drawing.COLOURS[0], linewidth=1.4)
            axes.plot(row["success_difference"], line, "o", color=drawing.COLOURS[0], markersize=4)
        axes.axvline(0.0, color="black", linewidth=0.8)
        axes.set_yticks(range(len(rows)), [row["variant"] for row in rows])
        axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel="success minus the default's, % points")
        write_atomically(picture, figure_to_png(figure))
