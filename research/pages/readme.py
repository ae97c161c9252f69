"""Results in the README: `python -m research readme RESULTS_JSON` writes scores and effort.

With `--robots` it writes the table of other robots too. `python -m research results` draws the figures.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from quad_env.files.writing import write_atomically
from research.pages import evaluations
from research.pages.blocks import insert_block, read_page

ROBOTS = "robots"
"""Name of the block with the table of other robots."""


@dataclass(frozen=True)
class ReadmeOptions:
    """Write the results into the README."""

    results: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation/results.json")
    """results.json of an evaluation."""
    readme: Path = Path("README.md")
    """File with the lines `<!-- results -->` and `<!-- /results -->`, between which they go."""
    picture: Path = Path("docs/results/evaluation.png")
    """PNG of the success of every policy on every axis, to be shown."""
    robots: tuple[Path, ...] = ()
    """results.json of evaluations of other robots, a row each, for the place `<!-- robots -->`."""


def main(options: ReadmeOptions) -> int:
    """Write the results into the README, and return the exit code. Raises UsageError."""
    text = read_page(options.readme)
    results = evaluations.read_results(options.results)
    results_of_robots = [evaluations.read_results(path) for path in options.robots]
    picture = Path(os.path.relpath(options.picture, options.readme.parent)).as_posix()
    lines = [
        *evaluations.overview_lines(results),
        "",
        evaluations.picture_links(results, picture),
        "",
        evaluations.made_by(results),
    ]
    text = insert_block(text, lines)
    if results_of_robots:
        commands = " ".join(map(evaluations.made_by, results_of_robots))
        text = insert_block(text, [*evaluations.robots_table(results_of_robots), "", commands], ROBOTS)
    write_atomically(options.readme, text.encode())
    return 0
