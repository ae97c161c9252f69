"""Table of success by scenario and policy for papers, as LaTeX, CSV or Markdown."""

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from evaluate.analysis.entries import Entry, Statistic
from evaluate.analysis.results import Results
from evaluate.analysis.score import SCORES
from evaluate.analysis.severity_levels import format_amount, severity_axes
from quad_env.cli.format import ABSENT, MINUS, NO_BREAK, break_name, estimate, with_count

NAME_WIDTH = 14
"""Largest number of characters in a line of the name of a policy above a LaTeX column."""
IQM = "interquartile mean"
"""Name of the table row with the interquartile means."""
CSV_COLUMNS = {
    "scenario": "name of the scenario; empty for a score",
    "axis": "name of the disturbance axis, or of the score",
    "severity": "severity in `severity_unit`; empty without a severity",
    "severity_unit": "unit of the severity",
    "policy": "name of the policy or of the group of training seeds",
    "training_seeds": "number of policies of the group; 1 for a policy",
    "episodes": "number of episodes of all training seeds on each scenario",
    "success_percent": "success, %",
    "success_low_percent": "lower end of the 95 % interval, %",
    "success_high_percent": "upper end of the 95 % interval, %",
}
"""Name of a column of the CSV table -> its meaning."""
_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        **{character: f"\\{character}" for character in "{}$&%#_"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "·": r"\ensuremath{\cdot}",
        "°": r"\ensuremath{^\circ}",
        "²": r"\ensuremath{^2}",
        MINUS: r"\ensuremath{-}",
        ABSENT: "--",
        NO_BREAK: "~",
        "…": r"\dots{}",
    }
)
"""Characters with a meaning in LaTeX, or outside of ASCII -> LaTeX code of the character."""


@dataclass(frozen=True)
class Row:
    """Row of the table: success of every entry on one scenario, or one score of every entry."""

    scenario: str
    """Name of the scenario; empty for a score."""
    axis: str
    """Name of the disturbance axis of the scenario, or name of the score."""
    severity: float
    """Severity in `unit`; 0 if the scenario belongs to no disturbance axis."""
    unit: str
    """Unit of the severity; empty if it has none."""
    success: tuple[Statistic | None, ...]
    """Success or score of each entry, 0 … 1; None if the entry did not run the scenario."""

    @property
    def cells(self) -> list[str]:
        """Texts of the success of each entry, % with its interval: `92 [81, 97]`."""
        return [_percent(success) for success in self.success]


@dataclass(frozen=True)
class PaperTable:
    """Table of success by scenario and entry, which three functions of this module write as text."""

    entries: tuple[Entry, ...]
    """Policies and groups of training seeds, one for each column of numbers."""
    rows: tuple[Row, ...]
    """Rows of the scenarios, grouped by disturbance axis, the mildest severity first."""
    scores: tuple[Row, ...]
    """Rows of the scores and interquartile means below the scenarios."""
    episodes: int
    """Number of episodes of each policy on each scenario."""


def make_table(results: Results, entries: Sequence[Entry], scenarios: Sequence[str] = ()) -> PaperTable:
    """Make the table of success of a run.

    Args:
        results: Results of the run.
        entries: Policies and groups of training seeds, in the order of the columns.
        scenarios: Names of the scenarios of the rows; empty for all scenarios with the scores.

    Returns:
        The table.
    """
    rows = [
        Row(
            scenario=level.name,
            axis=axis.name,
            severity=level.severity,
            unit=axis.unit if level.severity else "",
            success=tuple(entry.success.get(level.name) for entry in entries),
        )
        for axis in severity_axes(results.cells)
        for level in axis.scenarios
        if not scenarios or level.name in scenarios
    ]
    scores = () if scenarios else tuple(_score_rows(entries))
    return PaperTable(tuple(entries), tuple(rows), scores, results.episodes)


def _score_rows(entries: Sequence[Entry]) -> Iterator[Row]:
    """Yield the rows of the scores that an entry has, each followed by the interquartile means if there are groups."""
    statistics: dict[str, Callable[[Entry], Statistic]] = {SCORES[0]: lambda entry: entry.score}
    if any(entry.is_group for entry in entries):
        statistics[IQM] = lambda entry: entry.interquartile_mean
    statistics[SCORES[1]] = lambda entry: entry.hardware_score
    if any(entry.is_group for entry in entries):
        statistics[f"hardware {IQM}"] = lambda entry: entry.hardware_interquartile_mean
    for name, statistic in statistics.items():
        values = tuple(statistic(entry) for entry in entries)
        if any(math.isfinite(value.value) for value in values):
            yield Row("", name, 0.0, "", values)


def _percent(success: Statistic | None) -> str:
    """Format a success rate and its interval in %, as the report does; a dash if there is none."""
    if success is None or not math.isfinite(success.value):
        return ABSENT
    text = estimate(success.value, success.ci, 0, 100.0)
    return f"{text.value} {text.brackets.replace(NO_BREAK, ' ')}".rstrip()


def to_csv(table: PaperTable) -> str:
    """Write the table as CSV, one line for each scenario and entry, with the columns CSV_COLUMNS."""
    text = io.StringIO()
    writer = csv.DictWriter(text, CSV_COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in (*table.rows, *table.scores):
        for entry, success in zip(table.entries, row.success, strict=True):
            if success is not None:
                writer.writerow(_csv_line(row, entry, success))
    return text.getvalue()


def _csv_line(row: Row, entry: Entry, success: Statistic) -> Mapping[str, object]:
    """Return the line of one row and entry of the table: name of a column in CSV_COLUMNS -> value."""
    numbers = (success.value, *success.ci)
    value, low, high = (f"{100.0 * number:.10g}" if math.isfinite(number) else "" for number in numbers)
    return {
        "scenario": row.scenario,
        "axis": row.axis,
        "severity": f"{row.severity:.10g}" if row.severity else "",
        "severity_unit": row.unit,
        "policy": entry.name,
        "training_seeds": len(entry.policies),
        "episodes": entry.episodes,
        "success_percent": value,
        "success_low_percent": low,
        "success_high_percent": high,
    }


def to_markdown(table: PaperTable) -> str:
    """Write the table as Markdown, one line for each scenario and one column for each entry."""
    heads = ["axis, unit", "severity", *(f"{_name(entry)}: success, % [95 % interval]" for entry in table.entries)]
    lines = [_markdown_line(heads), _markdown_line(["---", "---:", *("---:" for _ in table.entries)])]
    lines += [_markdown_line([*_row_heads(row), *row.cells]) for row in (*table.rows, *table.scores)]
    return "\n".join(lines) + "\n"


def _markdown_line(cells: Sequence[str]) -> str:
    """Return a line of a Markdown table; vertical bars in the `cells` are escaped."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def to_latex(table: PaperTable, columns: int, source: str) -> str:
    """Write the table as a LaTeX float that needs the package booktabs.

    Args:
        table: Table of a run.
        columns: Number of text columns that the float spans, 1 or 2.
        source: Command that writes the table, for a comment at its top.

    Returns:
        LaTeX code of ASCII characters, except for letters of other scripts in names.
    """
    float_name = "table" if columns == 1 else "table*"
    count = len(table.entries)
    heads = " & ".join(_stacked(entry) for entry in table.entries)
    lines = [
        f"% {source}",
        r"% Needs \usepackage{booktabs}.",
        rf"\begin{{{float_name}}}",
        r"  \centering",
        rf"  \caption{{{_caption(table)}}}",
        r"  \label{tab:success}",
        r"  \footnotesize",
        rf"  \begin{{tabular}}{{lr{'r' * count}}}",
        r"    \toprule",
        rf"    & & \multicolumn{{{count}}}{{c}}{{success, \% [95\,\% interval]}} \\",
        rf"    \cmidrule(l){{3-{count + 2}}}",
        rf"    axis, unit & severity & {heads} \\",
        r"    \midrule",
        *(f"    {line}" for line in _latex_rows(table.rows)),
    ]
    if table.scores:
        lines += [r"    \midrule", *(f"    {_latex_row(row, row.axis)}" for row in table.scores)]
    lines += [r"    \bottomrule", r"  \end{tabular}", rf"\end{{{float_name}}}"]
    return "\n".join(lines) + "\n"


def _latex_rows(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of the scenarios; the name of an axis is only in its first line."""
    previous_count = 0
    for _, group in groupby(rows, key=lambda row: row.axis):
        axis_rows = [*group]
        if previous_count and max(previous_count, len(axis_rows)) > 1:
            yield r"\addlinespace"
        previous_count = len(axis_rows)
        for index, row in enumerate(axis_rows):
            yield _latex_row(row, "" if index else _row_heads(row)[0])


def _latex_row(row: Row, head: str) -> str:
    """Return a line of the LaTeX table with the text `head` in its first column."""
    cells = [head, _row_heads(row)[1], *row.cells]
    return f"{' & '.join(cell.translate(_LATEX) for cell in cells)} \\\\"


def _row_heads(row: Row) -> tuple[str, str]:
    """Return the texts of the first two columns of a row: axis with the unit of its severity, and the severity."""
    axis = f"{row.axis}, {row.unit}" if row.unit else row.axis
    return axis, format_amount(row.severity) if row.severity else ""


def _name(entry: Entry) -> str:
    """Return the name of an entry, with the number of training seeds of a group."""
    return f"{entry.name} ({len(entry.policies)} seeds)" if entry.is_group else entry.name


def _stacked(entry: Entry) -> str:
    """Return LaTeX code of the name of an entry, in lines of at most NAME_WIDTH characters."""
    lines = [line.strip().translate(_LATEX) for line in break_name(entry.name, NAME_WIDTH)]
    if entry.is_group:
        lines.append(f"{len(entry.policies)} seeds")
    stacked = r" \\ ".join(lines)
    return stacked if len(lines) == 1 else rf"\shortstack[r]{{{stacked}}}"


def _caption(table: PaperTable) -> str:
    """Return the caption of the LaTeX table: number of episodes, and methods of the intervals."""
    seeds = "; groups of training seeds: over seeds and episodes" if any(e.is_group for e in table.entries) else ""
    episodes = with_count(table.episodes, "episode")
    text = f"Success of {episodes} of each policy on each scenario, with 95 % intervals (rates: Wilson{seeds})."
    return text.translate(_LATEX).replace(r" \%", r"\,\%")
