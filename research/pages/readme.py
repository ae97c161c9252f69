"""The README's results: `python -m research readme RESULTS_JSON` writes scores and a figure.

With `--robots` it writes the table of other robots too. The figure is the one of `python -m research results`.
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
    """Write the README and its figure; the exit code. Raises UsageError."""
    text, found = page_with(options.readme), evaluations.read(options.results)
    where = Path(os.path.relpath(options.picture, options.readme.parent)).as_posix()
    figure = f"![{evaluations.ALT}]({where})"
    made_by = evaluations.made_by(found)
    about = evaluations.legend(found)
    text = insert(text, [*([about, ""] if about else []), evaluations.headline(found), "", figure, "", made_by])
    if options.robots:
        others = [evaluations.read(path) for path in options.robots]
        commands = " ".join(map(evaluations.made_by, others))
        text = insert(text, [*evaluations.robots_table(others), "", commands], ROBOTS)
    evaluations.draw(found, options.picture)
    write_atomically(options.readme, text.encode())
    return 0
