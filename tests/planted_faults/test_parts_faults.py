"""Faults of an evaluation in parts: episodes numbered from zero, conflicting rows merged, wrong parts accepted."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from evaluate.commands import merge
from evaluate.records import episode_table, parts
from evaluate.records.store import EPISODES
from quad_env.cli.part import Part
from tests.evaluate.split import RUN, evaluate, short_runs, write_altered, write_parts, write_slice
from tests.planted_faults.harness import Faults, checks_of, fault_tests

SMALL = ("--policies", "stand", "--scenarios", "flat", "--episodes", "4")
_FOLDER = tempfile.TemporaryDirectory()


@cache
def whole_run() -> Path:
    """Return the folder of a run without parts."""
    folder = Path(_FOLDER.name) / "whole"
    with short_runs():
        assert evaluate(*RUN, *SMALL, "--out", folder)[0] == 0
    return folder


def merged(*folders: Path, out: Path) -> tuple[int, str]:
    """Merge parts, and return exit code and stderr."""
    with short_runs():
        return evaluate("merge", *folders, "--out", out)


def check_parts_are_the_same_bytes_as_one_run() -> None:
    with tempfile.TemporaryDirectory() as name:
        with short_runs():
            folders = write_parts(Path(name), 2, *SMALL)
        assert merged(*folders, out=Path(name) / "all")[0] == 0
        assert (Path(name) / "all" / EPISODES).read_bytes() == (whole_run() / EPISODES).read_bytes()


def check_an_episode_in_two_parts_is_refused() -> None:
    with tempfile.TemporaryDirectory() as name:
        first = write_slice(whole_run(), Path(name) / "first", Part(1, 2), 0, 3)
        second = write_slice(whole_run(), Path(name) / "second", Part(2, 2), 2, 4)
        code, error = merged(first, second, out=Path(name) / "all")
        assert (code, "episode 2 of flat" in error) == (2, True)


def check_a_part_of_another_processor_is_refused() -> None:
    with tempfile.TemporaryDirectory() as name:
        first = write_slice(whole_run(), Path(name) / "first", Part(1, 2), 0, 2)
        second = write_slice(whole_run(), Path(name) / "second", Part(2, 2), 2, 4)
        other = write_altered(second, Path(name) / "other", lambda old: replace(old, cpu="an abacus"))
        code, error = merged(first, other, out=Path(name) / "all")
        assert (code, "an abacus" in error) == (2, True)


def _numbered_from_zero(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(parts, "table", lambda cell, _: episode_table.table(cell))


def _the_first_of_two_rows(patch: pytest.MonkeyPatch) -> None:
    true_join = merge.join_parts

    def join(stored: Any, manifest: Any) -> Any:
        run = true_join(stored, manifest)
        rows = [episode_table.table(cell).slice(0, manifest.episodes) for cell in run.cells]
        cells = [episode_table.cell_of(each, cell.scenario) for each, cell in zip(rows, run.cells, strict=True)]
        return replace(run, cells=tuple(cells))

    patch.setattr(merge, "join_parts", join)
    patch.setattr(merge, "gaps_and_overlaps", lambda *_: [])


def _any_processor(patch: pytest.MonkeyPatch) -> None:
    true = merge._differences
    patch.setattr(merge, "_differences", lambda stored, _: true(stored, True))


FAULTS: Faults = {
    "a part's episodes numbered from zero": (_numbered_from_zero, check_parts_are_the_same_bytes_as_one_run),
    "the first of two conflicting rows": (_the_first_of_two_rows, check_an_episode_in_two_parts_is_refused),
    "every processor accepted": (_any_processor, check_a_part_of_another_processor_is_refused),
}

test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
