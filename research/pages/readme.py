"""The README's results: `python -m research readme RESULTS_JSON` writes scores, effort and figures.

With `--robots` it writes the table of other robots too. The figures are those of `python -m research results`.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from quad_env.files.writing import write_atomically
from research.pages import evaluations
from research.pages.places import insert, page_with

ROBOTS = "robots"
"""Name of the place for the table of other robots."""


@dataclass(frozen=True)
class Options:
    """Write the results into the README."""

    results: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation/results.json")
    """results.json of an evaluation."""
    readme: Path = Path("README.md")
    """File with the lines `<!-- results -->` and `<!-- /results -->`, between which they go."""
    picture: Path = Path("docs/results/evaluation.png")
    """PNG of the success of every policy on every axis, to be written."""
    robots: tuple[Path, ...] = ()
    """results.json of evaluations of other robots, a row each, for the place `<!-- robots -->`."""


def main(options: Options) -> int:
    """Write the README and its figures; the exit code. Raises UsageError."""
    text, found = page_with(options.readme), evaluations.read(options.results)
    others = {_picture_of(path, options): evaluations.read(path) for path in options.robots}
    said, *table = evaluations.overview(found)
    lines = ["<br>".join(filter(None, (evaluations.legend(found), said))), *table, ""]
    lines += [evaluations.pictures(found, _seen(options.picture, options)), "", evaluations.made_by(found)]
    text = insert(text, lines)
    if others:
        commands = " ".join(map(evaluations.made_by, others.values()))
        text = insert(text, [*evaluations.robots_table(list(others.values())), "", commands], ROBOTS)
    for picture, one in {**others, options.picture: found}.items():
        evaluations.draw(one, picture)
    write_atomically(options.readme, text.encode())
    return 0


def _picture_of(results: Path, options: Options) -> Path:
    """Where the figure of another robot goes: next to the first, called as the folder of its results."""
    return options.picture.with_name(f"{results.resolve().parent.name}.png")


def _seen(picture: Path, options: Options) -> str:
    """A picture's place, seen from the README."""
    return Path(os.path.relpath(picture, options.readme.parent)).as_posix()
