"""Results in the README: `python -m research readme RESULTS_JSON` writes scores and effort.

RESULTS_JSON is the file results.json of an evaluation. With `--robots`, the command also writes the table of scores on
other robots. It does not draw the plots that the README shows; `python -m research results` draws them.
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
"""Name of the part of the README into which the command `readme` writes the scores on other robots.

The part is between the lines `<!-- robots -->` and `<!-- /robots -->`.
"""


@dataclass(frozen=True)
class ReadmeOptions:
    """Options of the command `readme`, which writes results into the README."""

    results: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation/results.json")
    """File results.json of an evaluation."""
    readme: Path = Path("README.md")
    """Markdown file; the results are written between `<!-- results -->` and `<!-- /results -->`."""
    picture: Path = Path("docs/results/evaluation.png")
    """PNG file with the success of every policy on every axis, which the README shows."""
    robots: tuple[Path, ...] = ()
    """Files results.json of evaluations of other robots, for the table at `<!-- robots -->`."""


def main(options: ReadmeOptions) -> int:
    """Run the command `readme`: write the results into the README.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
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
