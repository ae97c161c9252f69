"""Report section on failures: worst and most typical failure of each policy on each disturbance axis."""

import math
import shlex
from html import escape
from itertools import groupby
from pathlib import Path

from evaluate.analysis import failures as analysis
from evaluate.analysis.failures import PAGES_FOLDER, FailedEpisode
from evaluate.analysis.results import Results
from evaluate.report.html import breakable, collapsible, note, section, table
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT

LEAD = (
    "Worst: the first fall, or else the first failure, at the mildest level at which the policy fails. Typical: the "
    "failure nearest to the median time among those with the policy's most frequent cause on the axis. python -m "
    "evaluate report {} --pages makes and links a page of each: film and curves."
)
"""Explanation that is printed above the tables of failures."""
HEADS = {"axis": "axis", "which": "failure", "where": "scenario", "cause": "cause", "time": "time, s", "page": "page"}
"""Name of a column of the tables of failures -> its heading."""


def render_failures(results: Results, folder: Path) -> str:
    """Render the section on failures: a table of failures for each policy.

    Args:
        results: Results of the run.
        folder: Folder of the report, which may contain HTML pages of episodes. If a failed episode has a page, its row
            has a link to the page. Otherwise its row has the command that makes the page.

    Returns:
        HTML of the section; empty if no episode failed.
    """
    tables = []
    by_policy = groupby(analysis.select_failures(results), key=lambda selected: selected[1].policy)
    for policy, selection in by_policy:
        rows = [_row(kind, failure, folder) for kind, failure in selection]
        axes = len({row["axis"] for row in rows})
        head = f"{policy_label(results, policy)}: failures on {axes} {'axis' if axes == 1 else 'axes'}"
        tables.append(collapsible(head, table(HEADS, rows, "text")))
    lead = note(LEAD.format(shlex.quote(str(folder))))
    return section("Worst and most typical failures", lead, *tables) if tables else ""


def _row(kind: str, failure: FailedEpisode, folder: Path) -> dict[str, str]:
    """Return the table row of one failed episode: name of a column -> contents of the cell as HTML.

    `kind` is the reason for the selection of the episode: `worst`, `typical` or `worst and typical`. `folder` is the
    folder of the report.
    """
    command = f"python -m evaluate replay {shlex.quote(str(folder))} {failure.row} --page {failure.row}.html"
    link = f'<a href="{PAGES_FOLDER}/{escape(failure.page)}">episode {failure.number}</a>'
    return {
        "axis": breakable(failure.axis),
        "which": kind,
        "where": breakable(failure.scenario),
        "cause": (failure.cause or ABSENT).replace("_", " "),
        "time": f"{failure.time:.2f}" if math.isfinite(failure.time) else ABSENT,
        "page": link if (folder / PAGES_FOLDER / failure.page).is_file() else f"<code>{escape(command)}</code>",
    }
