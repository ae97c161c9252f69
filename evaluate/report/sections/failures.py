"""The worst and the most typical failure of each policy on each axis, with the page of each."""

import math
import shlex
from collections.abc import Iterator
from html import escape
from itertools import groupby
from pathlib import Path

from evaluate.analysis import failures as analysis
from evaluate.analysis.failures import PAGES, Failure
from evaluate.analysis.results import Results
from evaluate.report.html import breakable, fold, note, section, table
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT, counted

LEAD = (
    "Worst: the first fall, or else the first failure, at the mildest level at which the policy fails. Typical: of the "
    "failures with the policy's most frequent cause on the axis the one nearest to their median time."
)
HEADS = {"axis": "axis", "which": "failure", "where": "scenario", "cause": "cause", "time": "time, s", "page": "page"}


def failures(results: Results, folder: Path) -> str:
    """A table for each policy; a failure whose page is in that folder, the report's, has a link, any other one the
    command that makes it."""
    found = groupby(analysis.failures(results), key=lambda each: each[1].policy)
    tables = [_of_policy(results, policy, list(chosen), folder) for policy, chosen in found]
    command = f"python -m evaluate report {shlex.quote(str(folder))} --pages makes and links these pages."
    return section("Failures to look at", note(f"{LEAD} {command}"), *tables) if tables else ""


def _of_policy(results: Results, policy: str, chosen: list[tuple[str, Failure]], folder: Path) -> str:
    count = counted(len(chosen), "failure")
    return fold(f"{policy_label(results, policy)}: {count}", table(HEADS, _rows(results, chosen, folder), "text"))


def _rows(results: Results, chosen: list[tuple[str, Failure]], folder: Path) -> Iterator[dict[str, str]]:
    command = f"python -m evaluate replay {shlex.quote(str(folder))}"
    for which, each in chosen:
        name = each.page(results)
        link, again = (
            f'<a href="{PAGES}/{escape(name)}">episode {each.number}</a>',
            f"{command} {each.row} --page {each.row}.html",
        )
        yield {
            "axis": breakable(each.axis),
            "which": which,
            "where": breakable(each.scenario),
            "cause": escape((each.cause or ABSENT).replace("_", " ")),
            "time": f"{each.time:.2f}" if math.isfinite(each.time) else ABSENT,
            "page": link if (folder / PAGES / name).is_file() else f"<code>{escape(again)}</code>",
        }
