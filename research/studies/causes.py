"""Validation of the rules of causes: `python -m research causes`.

The rules are compared with episodes made to fail, and with a person's reading of films. With `--films FOLDER` strips of
failures of a run are drawn; the causes by the rules are written to `key.csv` next to the folder, where a reader does
not look. With `--reading FILE` the two are compared.
"""

import csv
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.causes.record import THRESHOLDS, EpisodeSignals
from evaluate.causes.rules import CAUSES
from evaluate.causes.verdict import Verdict, verdict
from evaluate.hardware import IDEAL
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.records.store import read_run
from evaluate.rollouts import rollout
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.writing import make_writable_folder, write_atomically
from research.pages.csv_text import to_csv
from research.pages.markdown import table
from research.pages.places import write_block
from research.studies.failure_films import draw_strip, frame_range
from research.studies.failures import CASES


@dataclass(frozen=True)
class CausesOptions:
    """Compare the rules of causes with episodes made to fail, or with a person's reading of films."""

    table: Path = Path("docs/results/causes.csv")
    """CSV file: episodes made for each cause, and the causes that the rules give them."""
    page: Path = Path("docs/causes.md")
    """Page with places for that table, the thresholds and the reading."""
    films: Path | None = None
    """Folder for strips of failures to be read; nothing else is written then but the key next to it."""
    run: Path = Path("results/evaluation")
    """Folder of the run whose failures are filmed."""
    count: int = 30
    """Strips (count)."""
    reading: Path | None = None
    """CSV file of what a person read, columns `film` and `cause`; with `--key` its table is written into the page."""
    key: Path = Path("key.csv")
    """What the rules say of these films, as `--films` wrote it."""


def main(options: CausesOptions) -> int:
    """Run the command and return the exit code. Raises UsageError."""
    check_numbers(options, {"count": (1, 999)})
    if options.films is not None:
        return draw_strips(options, options.films)
    if options.reading is not None:
        return compare_reading(options, options.reading)
    rows = list(count_causes())
    write_atomically(options.table, to_csv(rows))
    heads = {name: name.replace("_", " ") for name in ("made_for", "episodes", "right", "certain", "certain_and_wrong")}
    write_block(options.page, [table(heads, [{name: str(row[name]) for name in heads} for row in rows])], "agreement")
    columns = {name: name for name in ("threshold", "value", "unit", "reason")}
    lines = (dict(zip(columns, map(str, (name, *of)), strict=True)) for name, of in THRESHOLDS.items())
    write_block(options.page, [table(columns, lines)], "thresholds")
    return 0


def count_causes() -> Iterator[dict[str, Any]]:
    """Yield a row per cause: the episodes made for it, and their causes by the rules."""
    for cause in CAUSES:
        runs = (case.run() for case in CASES if case.cause == cause)
        given = Counter(
            (each.event.cause, each.certain) for episodes in runs for _, each in diagnose_failures(episodes)
        )
        by_cause, sure = {each: given[each, True] + given[each, False] for each in CAUSES}, given[cause, True]
        certain = sum(given[each, True] for each in CAUSES)
        counts = {"episodes": given.total(), "right": by_cause[cause], "certain": certain}
        yield {"made_for": cause, **counts, "certain_and_wrong": certain - sure, **by_cause}


def diagnose_failures(episodes: Episodes) -> Iterator[tuple[EpisodeSignals, Verdict]]:
    """Yield each failed episode with its cause."""
    measures = measure(episodes)
    for number in np.flatnonzero(measures.outcome != SUCCEEDED).tolist():
        assert episodes.scenario is not None
        record = EpisodeSignals(episodes, episodes.scenario, number)
        yield record, verdict(record, measures)


def draw_strips(options: CausesOptions, folder: Path) -> int:
    """Draw strips of failures of a run, at most one of each policy and scenario.

    Two falls are drawn for each other failure. Raises UsageError for an unusable folder.

    Args:
        options: Options of the command.
        folder: Folder for the strips.

    Returns:
        The exit code.
    """
    make_writable_folder(folder)
    draw, key = np.random.default_rng(0), list[dict[str, Any]]()
    cells = [cell for cell in read_run(options.run).cells if cell.scenario.axis]
    for cell in map(cells.__getitem__, draw.permutation(len(cells))):
        fell = cell.measures.fell
        if not (failed := np.flatnonzero(fell if len(key) % 3 < 2 else ~fell & ~cell.measures.succeeded)).size:
            continue
        policy = IDEAL.policy(cell.policy, on_hardware_profile=cell.scenario.hardware)
        episodes = rollout.run(policy, cell.scenario, cell.seeds[[draw.choice(failed)]])
        [(record, why)], name = diagnose_failures(episodes), f"{len(key):02d}.png"
        draw_strip(policy, record, frame_range(record, measure(episodes), draw.uniform(0.1, 0.5))).save(folder / name)
        what = {"policy": cell.policy, "scenario": cell.scenario.name, "seed": int(episodes.seeds[0])}
        key.append({"film": name, **what, "cause": why.event.cause, "certain": why.certain, "detail": why.detail})
        write_atomically(folder.with_name("key.csv"), to_csv(key))
        if len(key) == options.count:
            break
    return 0


def compare_reading(options: CausesOptions, reading: Path) -> int:
    """Write the confusion table of the rules and a person's reading.

    Args:
        options: Options of the command.
        reading: CSV file of the reading.

    Returns:
        The exit code.

    Raises:
        UsageError: The files do not fit together, or name an unknown cause.
    """
    try:
        key, seen = (csv.DictReader(path.read_text(encoding="utf-8").splitlines()) for path in (options.key, reading))
        person = {row["film"]: row for row in seen}
        films = [{**row, "read": person[row["film"]]["cause"]} for row in key]
    except (OSError, KeyError) as error:
        words = f"{options.key} and {reading} need columns film and cause, of the same films"
        raise UsageError(f"{words}: {error}") from None
    if unknown := {row["read"] for row in films} - set(CAUSES):
        raise UsageError(f"unknown causes {', '.join(sorted(unknown))}; valid: {', '.join(CAUSES)}")
    pairs = Counter((row["cause"], row["read"]) for row in films)
    sure = [row["cause"] == row["read"] for row in films if row["certain"] == "True"]
    same = sum(count for (rule, other), count in pairs.items() if rule == other)
    said = f"They agree on {same} of {len(films)} films, on {sum(sure)} of the {len(sure)} where the rules are certain."
    heads = [cause for cause in CAUSES if any(cause == other for _, other in pairs)]
    body = [{cause: str(pairs[rule, cause] or "") for cause in heads} | {"by the rules": rule} for rule in CAUSES]
    filled, names = [row for row in body if any(map(row.get, heads))], {name: name for name in ("by the rules", *heads)}
    write_block(options.page, [f"{said} Rows: the rules; columns: the person.", "", table(names, filled)], "reading")
    films = [{**row, "remark": person[row["film"]].get("remark", "")} for row in films]
    write_atomically(options.table.with_name("causes_films.csv"), to_csv(films))
    return 0
