"""A short evaluation in parts, for several test files."""

import contextlib
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.analysis.results import Results, results_to_json
from evaluate.records import manifest
from evaluate.records.episode_table import cell_of, table
from evaluate.records.manifest import Manifest
from evaluate.records.parts import join_parts, read_part, write_part
from evaluate.records.shares import Share
from evaluate.records.store import Run, read_run
from quad_env.cli.part import Part
from quad_env.files.writing import write_atomically
from tests.seams import replace_report, short_episodes

STEPS = 150
RUN = ("--policies", "stand", "trot@flat", "--scenarios", "flat", "push:4", "--episodes", "5", "--seed", "2")


def a_page(results: Results, path: Path, **_options: object) -> None:
    """Write a short text instead of the report, because its plots take a second."""
    write_atomically(path, repr(results_to_json(results)).encode())


@contextlib.contextmanager
def short_runs() -> Iterator[None]:
    """Shorten the episodes and reports within the context."""
    with pytest.MonkeyPatch.context() as patch:
        short_episodes(patch, STEPS)
        replace_report(patch, a_page)
        yield


def evaluate(*words: object) -> tuple[int, str]:
    """Return exit code and stderr of the command."""
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        code = main([str(word) for word in words])
    return code, error.getvalue()


def refused(*words: object) -> str:
    """Return the only line on stderr of a command that is refused."""
    code, error = evaluate(*words)
    assert (code, error.count("\n")) == (2, 1), error
    return error


def write_parts(folder: Path, count: int, *words: object) -> list[Path]:
    """Evaluate every part of the run into a folder of its own."""
    folders = [folder / str(number) for number in range(1, count + 1)]
    for number, out in enumerate(folders, 1):
        code, error = evaluate(*RUN, *words, "--part", f"{number}/{count}", "--out", out)
        assert code == 0, error
    return folders


def write_altered(part: Path, folder: Path, change: Callable[[Manifest], Manifest]) -> Path:
    """Write a copy of a part with a changed manifest, with consistent hashes, into a folder."""
    stored = read_part(part)
    run = replace(join_parts([stored], stored.manifest), manifest=change(stored.manifest).with_fingerprint())
    folder.mkdir(parents=True)
    write_part(run, folder)
    return folder


def write_slice(whole: Path, folder: Path, part: Part, first: int, end: int) -> Path:
    """Write a part with a range of the episodes of a whole run, on every scenario, into a folder."""
    run = read_run(whole)
    share = Share(part, {scenario.name: (first, end) for scenario in run.manifest.scenarios})
    cells = [cell_of(table(cell).slice(first, end - first), cell.scenario) for cell in run.cells]
    folder.mkdir(parents=True)
    write_part(Run(replace(manifest.read(whole), share=share), tuple(cells)), folder)
    return folder
