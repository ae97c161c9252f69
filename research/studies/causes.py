"""Validation of the rules that find the cause of a failed episode: `python -m research causes`.

By default, the rules are applied to episodes that were made to fail for a known cause. `--films FOLDER` draws images of
failed episodes from an evaluation, so that a person can judge the causes. The causes that the rules find are written to
key.csv next to the folder, so that the person does not see them. `--reading FILE` compares the causes that the person
has written into FILE with the causes that the rules find.
"""

import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.causes.record import THRESHOLDS, EpisodeSignals
from evaluate.causes.rules import CAUSES
from evaluate.causes.verdict import Verdict, verdict
from evaluate.cells import PolicyScenarioResult
from evaluate.hardware import IDEAL
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.records.store import read_run
from evaluate.rollouts import rollout
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.writing import make_writable_folder, write_atomically
from research.pages.blocks import write_block
from research.pages.csv_text import to_csv
from research.pages.markdown import table
from research.studies.failure_films import draw_strip, frame_range
from research.studies.failures import CASES


@dataclass(frozen=True)
class CausesOptions:
    """Options of the command `causes`, which tests the rules that find the cause of a failed episode."""

    table: Path = Path("docs/results/causes.csv")
    """CSV file for the causes that the rules find in episodes that were made to fail for a known cause."""
    page: Path = Path("docs/causes.md")
    """Markdown page to update with correctness and thresholds of the rules, and a person's judgement."""
    films: Path | None = None
    """Folder for images of failed episodes, which a person judges; nothing else except `key.csv` is written."""
    run: Path = Path("results/evaluation")
    """Folder of the evaluation from which --films takes the failed episodes."""
    count: int = 30
    """Number of images of failed episodes that --films draws."""
    reading: Path | None = None
    """CSV file with the causes that a person sees in the images, columns `film` and `cause`."""
    key: Path = Path("key.csv")
    """CSV file, written by `--films`, with the causes that the rules find for the images of failed episodes."""


def main(options: CausesOptions) -> int:
    """Run the command `causes`: draw failed episodes, compare a person's judgement, or test the rules.

    Args:
        options: Options of the command, which select one of the three tasks.

    Returns:
        Exit code of the process.
    """
    check_numbers(options, {"count": (1, 999)})
    if options.films is not None:
        return draw_strips(options, options.films)
    if options.reading is not None:
        return compare_reading(options, options.reading)
    rows = list(count_causes())
    write_atomically(options.table, to_csv(rows))
    heads = {name: name.replace("_", " ") for name in ("made_for", "episodes", "right", "certain", "certain_and_wrong")}
    text_rows = [{name: str(row[name]) for name in heads} for row in rows]
    write_block(options.page, [table(heads, text_rows)], "agreement")
    columns = ("threshold", "value", "unit", "reason")
    thresholds = [
        dict(zip(columns, map(str, (name, *threshold)), strict=True)) for name, threshold in THRESHOLDS.items()
    ]
    write_block(options.page, [table({name: name for name in columns}, thresholds)], "thresholds")
    return 0


def count_causes() -> Iterator[dict[str, Any]]:
    """Simulate episodes that fail for a known cause, and count the causes that the rules find.

    Yields:
        Row of the table for one known cause: name of the column -> value. The row has a column for each cause, with the
        number of episodes for which the rules find this cause.
    """
    for made_for in CAUSES:
        runs = (case.run() for case in CASES if case.cause == made_for)
        verdicts = [verdict for episodes in runs for _, verdict in diagnose_failures(episodes)]
        counts = Counter((verdict.event.cause, verdict.certain) for verdict in verdicts)
        by_cause = {cause: counts[cause, True] + counts[cause, False] for cause in CAUSES}
        num_certain = sum(counts[cause, True] for cause in CAUSES)
        yield {
            "made_for": made_for,
            "episodes": len(verdicts),
            "right": by_cause[made_for],
            "certain": num_certain,
            "certain_and_wrong": num_certain - counts[made_for, True],
            **by_cause,
        }


def diagnose_failures(episodes: Episodes) -> Iterator[tuple[EpisodeSignals, Verdict]]:
    """Yield two objects for each failed episode: its recorded signals, and the cause that the rules find."""
    measures = measure(episodes)
    for number in np.flatnonzero(measures.outcome != SUCCEEDED).tolist():
        assert episodes.scenario is not None
        record = EpisodeSignals(episodes, episodes.scenario, number)
        yield record, verdict(record, measures)


def draw_strips(options: CausesOptions, folder: Path) -> int:
    """Draw strips of failed episodes of an evaluation, at most one for each policy and scenario.

    A strip is an image with frames and plotted signals of an episode. Two of three strips show a fall. The third one
    shows a failure without a fall. Scenarios without a disturbance axis are left out. The function raises UsageError if
    the folder cannot be written.

    Args:
        options: Options of the command.
        folder: Folder for the strips. The causes that the rules find are written to key.csv next to the folder.

    Returns:
        The exit code, 0.
    """
    make_writable_folder(folder)
    generator = np.random.default_rng(0)
    key = list[dict[str, Any]]()
    cells = [cell for cell in read_run(options.run).cells if cell.scenario.axis]
    for index in generator.permutation(len(cells)):
        measures = cells[index].measures
        is_candidate = measures.fell if len(key) % 3 < 2 else ~measures.fell & ~measures.succeeded
        candidates = np.flatnonzero(is_candidate)
        if not candidates.size:
            continue
        key.append(_draw_failure(cells[index], candidates, generator, folder / f"{len(key):02d}.png"))
        write_atomically(folder.with_name("key.csv"), to_csv(key))
        if len(key) == options.count:
            break
    return 0


def _draw_failure(
    cell: PolicyScenarioResult, candidates: NDArray[np.int64], generator: np.random.Generator, path: Path
) -> dict[str, Any]:
    """Draw the strip (image) of a random failed episode, and return the row of key.csv about this episode.

    Args:
        cell: Stored episodes of one policy on one scenario.
        candidates: Indices of the failed episodes, from which one is drawn at random, (k,).
        generator: Random generator.
        path: Image file to write.

    Returns:
        Name of the column -> value.
    """
    policy = IDEAL.policy(cell.policy, on_hardware_profile=cell.scenario.hardware)
    episodes = rollout.run(policy, cell.scenario, cell.seeds[[generator.choice(candidates)]])
    ((record, verdict),) = diagnose_failures(episodes)
    part = frame_range(record, measure(episodes), generator.uniform(0.1, 0.5))
    draw_strip(policy, record, part).save(path)
    return {
        "film": path.name,
        "policy": cell.policy,
        "scenario": cell.scenario.name,
        "seed": int(episodes.seeds[0]),
        "cause": verdict.event.cause,
        "certain": verdict.certain,
        "detail": verdict.detail,
    }


def compare_reading(options: CausesOptions, reading: Path) -> int:
    """Write the confusion matrix of the causes that the rules find and the causes that a person sees.

    Args:
        options: Options of the command.
        reading: CSV file with the causes that the person has seen in the strips, which are images of failed episodes.

    Returns:
        Exit code, 0.

    Raises:
        UsageError: The CSV files of the person and of the rules name different images, or a cause is unknown.
    """
    try:
        key = _read_csv(options.key)
        by_person = {row["film"]: row for row in _read_csv(reading)}
        films = [{**row, "read": by_person[row["film"]]["cause"]} for row in key]
    except (OSError, KeyError) as error:
        words = f"{options.key} and {reading} need columns film and cause, of the same films"
        raise UsageError(f"{words}: {error}") from None
    if unknown := {row["read"] for row in films} - set(CAUSES):
        raise UsageError(f"unknown causes {', '.join(sorted(unknown))}; valid: {', '.join(CAUSES)}")
    lines = [f"{_agreement(films)} Rows: the rules; columns: the person.", "", _confusion_table(films)]
    write_block(options.page, lines, "reading")
    films = [{**row, "remark": by_person[row["film"]].get("remark", "")} for row in films]
    write_atomically(options.table.with_name("causes_films.csv"), to_csv(films))
    return 0


def _read_csv(path: Path) -> list[dict[str, str]]:
    """Read the rows of a CSV file; each row is a dictionary: name of the column -> text."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def _agreement(films: Sequence[Mapping[str, str]]) -> str:
    """Return a sentence about the number of episodes for which rules and person name the same cause.

    A row of `films` describes one episode: cause by the rules (`cause`), cause by the person (`read`), and the text
    `True` in `certain` if the rules are certain.
    """
    agrees = [row["cause"] == row["read"] for row in films]
    certain_agrees = [row["cause"] == row["read"] for row in films if row["certain"] == "True"]
    return (
        f"They agree on {sum(agrees)} of {len(films)} films, "
        f"on {sum(certain_agrees)} of the {len(certain_agrees)} where the rules are certain."
    )


def _confusion_table(films: Sequence[Mapping[str, str]]) -> str:
    """Create the confusion matrix of rules and person as a Markdown table of numbers of episodes.

    A row of the table is a cause that the rules find; a column is a cause that the person sees. Empty rows and columns
    are left out. A row of `films` describes one episode: cause by the rules (`cause`), and cause by the person
    (`read`).
    """
    counts = Counter((row["cause"], row["read"]) for row in films)
    columns = [cause for cause in CAUSES if any(cause == read for _, read in counts)]
    rows = []
    for rule in CAUSES:
        row = {cause: str(counts[rule, cause] or "") for cause in columns}
        if any(row.values()):
            rows.append(row | {"by the rules": rule})
    return table({name: name for name in ("by the rules", *columns)}, rows)
