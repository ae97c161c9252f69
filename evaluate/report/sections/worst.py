"""The worst episodes of each policy: where to look first."""

import shlex
from html import escape
from pathlib import Path

import numpy as np

from evaluate.analysis.results import Results
from evaluate.report.html import fold, note, section, table
from evaluate.report.sections.figures import policy_label
from evaluate.rollouts.experiment import Cell
from quad_env.cli.format import number

LISTED = 5
"""Episodes a policy."""


def worst(results: Results, policy: str) -> list[tuple[Cell, int]]:
    """Cells and rows in them: falls where the policy falls least, earliest first; then the largest velocity errors."""
    cells = [cell for cell in results.cells if cell.policy == policy]
    cells.sort(key=lambda cell: results.summaries[cell.scenario.name, policy].fall_rate)
    earliest = ((cell, row) for cell in cells for row in np.argsort(cell.measures.fall_time, kind="stable").tolist())
    fallen = [(cell, row) for cell, row in earliest if cell.measures.fell[row]]
    upright = [(cell, row) for cell in cells for row in np.flatnonzero(~cell.measures.fell).tolist()]
    upright.sort(key=lambda place: -place[0].measures.velocity_error[place[1]])
    return [*fallen, *upright][:LISTED]


def worst_episodes(results: Results, folder: Path) -> str:
    """The section that lists them, each with the command that replays it."""
    lead = note(
        "Of each policy: falls on the scenarios where it falls least, earliest first; without a fall, the largest "
        "velocity errors. The command runs the episode again, bit for bit on the same class of machine; "
        "--video replay.webp films it."
    )
    heads = {"scenario": "scenario", "what": "what happened", "replay": "replay"}
    tables = (
        fold(
            policy_label(results, policy),
            table(heads, [_row(cell, episode, folder) for cell, episode in worst(results, policy)], "text"),
            printed=True,
        )
        for policy in results.policies
    )
    return section("Worst episodes", lead, *tables)


def replay_command(cell: Cell, episode: int, folder: Path) -> str:
    """What a shell needs to run an episode of that number again."""
    words = ("python", "-m", "evaluate", "replay", str(folder), str(episode))
    return shlex.join((*words, "--policy", cell.policy, "--scenario", cell.scenario.name))


def _row(cell: Cell, episode: int, folder: Path) -> dict[str, str]:
    reason, measures = cell.fall_reason[episode], cell.measures
    fall = f"{escape(reason or '')} at {number(measures.fall_time[episode], 2)} s"
    what = fall if reason else f"velocity error {number(measures.velocity_error[episode])} m/s"
    replay = f"<code>{escape(replay_command(cell, episode, folder))}</code>"
    return {"scenario": escape(cell.scenario.name), "what": what, "replay": replay}
