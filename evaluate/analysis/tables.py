"""Results of an evaluation as tables: one row for each episode, policy and scenario, or entry of the scores."""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pyarrow as pa

from evaluate.analysis.entries import Entry, Statistic, list_entries
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import axis_name
from evaluate.analysis.stored_run import analyse_run
from evaluate.analysis.summary import Summary
from evaluate.measures.extra import definition
from evaluate.records.store import read_rows, read_run
from quad_env.cli.command_line import UsageError

TableName = Literal["episodes", "summary", "scores"]
"""Name of a table of a run."""


class Column(NamedTuple):
    """Definition of a column of a table of a run."""

    unit: str
    """Unit of the values; empty for a text, a fraction or a pure number."""
    description: str
    """Meaning of the values."""


EPISODE_COLUMNS = {
    "policy": Column("", "label of the policy"),
    "scenario": Column("", "name of the scenario"),
    "severity": Column("unit of the axis", "severity of the scenario; 0 without a disturbance axis"),
    "episode": Column("", "index of the episode on the scenario, from 0"),
    "seed": Column("", "seed; env.reset(seed=seed) repeats the episode"),
    "fall_reason": Column("", "condition that ended the episode, such as trunk_contact; null without a fall"),
    "failure": Column("", "error message of the policy; null without an error"),
}
"""Name of a column of the episodes that is no measure -> its definition."""
SUMMARY_COLUMNS = {
    "policy": Column("", "label of the policy"),
    "group": Column("", "name of the group of training seeds; null for a single policy"),
    "scenario": Column("", "name of the scenario"),
    "axis": Column("", "name of the disturbance axis"),
    "severity": Column("severity_unit", "severity of the scenario; 0 without a disturbance axis"),
    "severity_unit": Column("", "unit of the severity"),
    "episodes": Column("", "number of episodes"),
    "success_rate": Column("", "proportion of successful episodes, 0 to 1"),
    "fall_rate": Column("", "proportion of episodes with a fall, 0 to 1"),
    "velocity_error": Column("m/s", "mean velocity error, heading frame"),
    "yaw_rate_error": Column("rad/s", "mean yaw-rate error"),
    "mean_velocity_error": Column("m/s", "error of the mean velocity of each command interval, heading frame"),
    "cost_of_transport": Column("", "energy / (weight * distance) of all episodes"),
}
"""Name of a column of the summary -> its definition; an interval has two further columns, `…_low` and `…_high`."""
SCORE_COLUMNS = {
    "entry": Column("", "label of the policy, or name of the group of training seeds"),
    "training_seeds": Column("", "number of policies of the entry"),
    "score": Column("", "mean success over the axes, without the hardware profile, 0 to 1"),
    "interquartile_mean": Column("", "mean of the middle half of the success rates, 0 to 1"),
    "hardware_score": Column("", "mean success over the axes, with the hardware profile, 0 to 1"),
    "hardware_interquartile_mean": Column("", "the interquartile mean with the hardware profile, 0 to 1"),
    "cost_of_transport": Column("", "energy / (weight * distance) on the scenario of the Pareto front"),
}
"""Name of a column of the scores -> its definition; an interval has two further columns, `…_low` and `…_high`."""
ENDS = {"low": "lower", "high": "upper"}
"""Ending of the name of a column with one end of a 95 % interval -> the end in words."""


@dataclass(frozen=True)
class RunTables:
    """Tables of a run as pyarrow tables, made by `load`.

    Every column has its unit and its meaning in the metadata of its field; `definitions` lists them.
    """

    folder: Path
    """Results folder of the run."""
    episodes: pa.Table
    """One row for each episode: policy, scenario, seed, outcome and all measures."""
    summary: pa.Table
    """One row for each policy and scenario: rates and means with 95 % intervals, as in the report."""
    scores: pa.Table
    """One row for each policy or group of training seeds: scores with 95 % intervals, as in the report."""

    def to_pandas(self, table: TableName = "episodes") -> Any:
        """Convert a table to a pandas DataFrame.

        Args:
            table: Name of the table.

        Returns:
            The DataFrame; null becomes NaN or None.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        selected = self._table(table)
        if importlib.util.find_spec("pandas") is None:
            text = "to_pandas: pandas is not installed; valid: pip install pandas, or the pyarrow tables themselves"
            raise ModuleNotFoundError(text, name="pandas")
        return selected.to_pandas()

    def definitions(self, table: TableName = "episodes") -> pa.Table:
        """Return unit and meaning of the columns of a table: one row for each column, named `column`."""
        fields = [*self._table(table).schema]
        texts = {key: [field.metadata[key.encode()].decode() for field in fields] for key in Column._fields}
        return pa.table({"column": [field.name for field in fields], **texts})

    def _table(self, name: str) -> pa.Table:
        """Return a table by its name; ValueError is raised for another name."""
        tables = {"episodes": self.episodes, "summary": self.summary, "scores": self.scores}
        if name not in tables:
            raise ValueError(f"table: unknown, got {name}; valid: {', '.join(tables)}")
        return tables[name]


def load(folder: str | Path) -> RunTables:
    """Load the results folder of an evaluation as tables.

    Args:
        folder: Results folder, finished or not.

    Returns:
        Tables of the finished pairs of policy and scenario.

    Raises:
        UsageError: The folder has no finished results.
    """
    path = Path(folder)
    run = read_run(path)
    if not run.cells:
        raise UsageError(f"{path} holds no finished part of a comparison yet")
    results = analyse_run(run)
    _, rows = read_rows(path)
    episodes = {name: EPISODE_COLUMNS.get(name) or _measure_column(name) for name in rows.column_names}
    return RunTables(path, _describe(rows, episodes), _summary_table(results), _score_table(list_entries(results)))


def _measure_column(name: str) -> Column:
    """Return the definition of the column of a measure."""
    measure = definition(name)
    frame = f"; frame: {measure.frame}" if measure.frame else ""
    return Column(measure.unit, f"{measure.title}: {measure.formula}{frame}")


def _describe(table: pa.Table, columns: Mapping[str, Column]) -> pa.Table:
    """Add the definition of each column of a table to the metadata of its field."""
    fields = []
    for field in table.schema:
        column = columns[field.name]
        metadata = {name.encode(): text.encode() for name, text in column._asdict().items()}
        fields.append(field.with_metadata({**(field.metadata or {}), **metadata}))
    return table.cast(pa.schema(fields, table.schema.metadata))


def _summary_table(results: Results) -> pa.Table:
    """Make the table with one row for each policy and scenario of a run."""
    groups = {policy: group.name for group in results.groups for policy in group.policies}
    scenarios = {cell.scenario.name: cell.scenario for cell in results.cells}
    rows = [
        {
            "policy": policy,
            "group": groups.get(policy),
            "scenario": scenario,
            "axis": axis_name(scenarios[scenario]),
            **_summary_values(summary),
        }
        for (scenario, policy), summary in results.summaries.items()
    ]
    return _make_table(rows, SUMMARY_COLUMNS)


def _summary_values(summary: Summary) -> dict[str, Any]:
    """Return the values of a summary: name of a column -> value; a number with an interval as Statistic."""
    values: dict[str, Any] = {}
    for name in SUMMARY_COLUMNS:
        if hasattr(summary, f"{name}_ci"):
            values[name] = Statistic(getattr(summary, name), getattr(summary, f"{name}_ci"))
        elif hasattr(summary, name):
            values[name] = getattr(summary, name)
    return values


def _score_table(entries: Sequence[Entry]) -> pa.Table:
    """Make the table with one row for each entry of the scores of a run."""
    statistics: dict[str, Callable[[Entry], Statistic]] = {
        "score": lambda entry: entry.score,
        "interquartile_mean": lambda entry: entry.interquartile_mean,
        "hardware_score": lambda entry: entry.hardware_score,
        "hardware_interquartile_mean": lambda entry: entry.hardware_interquartile_mean,
        "cost_of_transport": lambda entry: entry.cost,
    }
    rows = [
        {"entry": entry.name, "training_seeds": len(entry.policies)}
        | {name: statistic(entry) for name, statistic in statistics.items()}
        for entry in entries
    ]
    return _make_table(rows, SCORE_COLUMNS)


def _make_table(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, Column]) -> pa.Table:
    """Make a table from rows; a number with an interval becomes three columns, and NaN becomes null.

    Args:
        rows: Name of a column -> value, for each row.
        columns: Name of a column -> its definition, in the order of the table.

    Returns:
        The table, with the definitions in the metadata of its fields.
    """
    values: dict[str, pa.Array] = {}
    defined: dict[str, Column] = {}
    for name, column in columns.items():
        entries = [row[name] for row in rows]
        defined[name] = column
        if not isinstance(entries[0], Statistic):
            values[name] = pa.array(entries, from_pandas=True)
            continue
        values[name] = pa.array([entry.value for entry in entries], pa.float64(), from_pandas=True)
        for end, (suffix, word) in enumerate(ENDS.items()):
            values[f"{name}_{suffix}"] = pa.array([entry.ci[end] for entry in entries], pa.float64(), from_pandas=True)
            defined[f"{name}_{suffix}"] = Column(column.unit, f"{word} end of the 95 % interval of {name}")
    return _describe(pa.table(values), defined)
