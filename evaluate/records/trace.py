"""Traces: the record of a cell's episodes as a Parquet file, a row an episode, which other rules can score.

A signal is one list a row, the steps of each component side by side: so laid out, and with their bytes apart,
neighbours share most bytes, which is what the compression lives on.
"""

import json
from collections.abc import Container
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from evaluate.measures.episodes import METERED, OF_POLICY, TRUTHS, Episodes, Limits, blank, shapes
from evaluate.records import parquet
from evaluate.rollouts.experiment import TraceWriter
from evaluate.rollouts.hardware import IDEAL, hardware_of
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

FOLDER = "traces"
"""Inside the folder of the results."""
KEY = b"simple_quad_trace"
ROBOT = "robot"
"""Key of the robot's name or path, of another than the usual one."""
COMPACT = (
    *("command", "heading_velocity", "position", "height", "tilt", "phase"),
    *("foot_contact", "leg_contact", "trunk_contact", "stopped"),
)
"""Signals that fall rules, gait diagrams and velocity curves look at."""
PER_EPISODE: dict[str, type[np.generic]] = {
    **dict.fromkeys(("seeds", "fall_step", "divergence_step", "push_step"), np.int64),
    "fall_reason": np.object_,
    "push_impulse": np.float64,
}
"""What is kept of each episode as a whole, and its type."""
Kind = Literal["compact", "full"]
"""What to keep: the COMPACT signals, or every one, so that every measure can be taken again."""


@dataclass(frozen=True)
class Header:
    """What a trace is of."""

    policy: str
    scenario: str
    first: int
    """Number of its first episode in its cell."""
    kind: Kind


def writer(folder: Path, kind: Kind) -> TraceWriter:
    """Writes each chunk that it is given into a file in that folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return partial(_write_chunk, folder, kind)


def _write_chunk(folder: Path, kind: Kind, policy: str, scenario: Scenario, first: int, episodes: Episodes) -> None:
    write(episodes, Header(policy, scenario.name, first, kind), folder / name_of(policy, scenario.name, first))


def name_of(policy: str, scenario: str, first: int) -> str:
    """Name of the file of a chunk whose first episode has that number."""
    return f"{quote(policy, safe='')}--{quote(scenario, safe='')}--{first:07d}.parquet"


def keep_only(folder: Path, names: Container[str]) -> None:
    """Remove every other trace, and what a killed process left half written."""
    for path in (*folder.glob("*.parquet"), *folder.glob(".*.parquet.*")):
        if path.name not in names:
            path.unlink()


def write(episodes: Episodes, header: Header, path: Path) -> None:
    """Write a trace; ValueError if the episodes stopped at their falls, so that no other rule can score them."""
    if not episodes.after_falls:
        raise ValueError("these episodes were not recorded beyond their falls; run them with after_falls=True")
    wanted = shapes(episodes.robot) if header.kind == "full" else COMPACT
    signals = [name for name in wanted if getattr(episodes, name) is not None]
    table: dict[str, Any] = {name: getattr(episodes, name).tolist() for name in PER_EPISODE}
    if episodes.failure is not None:
        table["failure"] = pa.array(episodes.failure.tolist(), pa.string())
    for name in signals:
        rows = np.moveaxis(np.moveaxis(getattr(episodes, name), 1, 0), 1, -1)
        table[name] = pa.FixedSizeListArray.from_arrays(pa.array(rows.ravel()), rows[0].size)
    numbers = {
        field.name: getattr(episodes, field.name)
        for field in fields(Episodes)
        if field.type in (int, float, bool, Limits)
    }
    about = {"schema": 1, "steps": episodes.steps, "header": vars(header), "numbers": numbers}
    if (robot := str(episodes.robot.source or episodes.robot.name)) != IDEAL.robot:
        about[ROBOT] = robot
    parquet.write(
        pa.table(table),
        path,
        {KEY: json.dumps(about).encode()},
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=[f"{name}.list.element" for name in signals if name not in TRUTHS],
    )


def read(path: Path, kind: Kind = "full") -> tuple[Header, Episodes]:
    """A trace of at least that kind; of a compact one, the signals that it lacks are zero.

    ValueError for a file that is no trace, or a compact one where a full one is wanted.
    """
    table = parquet.read(path)
    about = json.loads((table.schema.metadata or {}).get(KEY, b"null"))
    if about is None or about["schema"] != 1:
        raise ValueError(f"{path} is no trace of this version")
    header, steps, count = Header(**about["header"]), about["steps"], table.num_rows
    if (header.kind, kind) == ("compact", "full"):
        raise ValueError(f"{path} is a compact trace: it lacks signals that measures need")
    robot = hardware_of(about.get(ROBOT, IDEAL.robot), str(path)).quadruped
    signals = {name: _signal(table, robot, name, steps, count) for name in shapes(robot)}
    whole = {name: np.array(table[name].to_pylist(), dtype=kind) for name, kind in PER_EPISODE.items()}
    whole["push_impulse"] = whole["push_impulse"].reshape(*whole["push_step"].shape, 2)
    if "failure" in table.column_names:
        whole["failure"] = np.array(table["failure"].to_pylist(), dtype=object)
    return header, Episodes(robot=robot, **signals, **whole, **about["numbers"])  # type: ignore[arg-type]


def _signal(table: Any, robot: Robot, name: str, steps: int, count: int) -> NDArray[np.generic] | None:
    """A policy without a clock has no phase; what a compact trace leaves out is zero, what none had
    before was not measured."""
    if name not in table.column_names:
        absent = blank(robot, name, steps, count)
        return None if name in OF_POLICY else np.full_like(absent, np.nan) if name in METERED else absent
    values = table[name].combine_chunks().flatten().to_numpy(zero_copy_only=False)
    rows: NDArray[np.generic] = values.reshape(count, *shapes(robot)[name], steps)
    return np.ascontiguousarray(np.moveaxis(np.moveaxis(rows, -1, 1), 0, 1))
