"""The worst episodes of each policy: where to look first."""

import shlex
from dataclasses import dataclass
from html import escape
from pathlib import Path

from evaluate.analysis.results import Results
from evaluate.report.html import fold, note, section, table
from evaluate.report.sections.figures import policy_label
from evaluate.rollouts.experiment import Cell
from evaluate.terminal.format import number

LISTED = 5
"""Episodes a policy."""


@dataclass(frozen=True)
class WorstEpisode:
    """One episode and what went wrong."""

    policy: str
    scenario: str
    episode: int
    """Row within its cell."""
    seed: int
    fall_reason: str | None
    fall_time: float
    """s; NaN without a fall."""
    velocity_error: float
    """m/s"""


def worst(results: Results, policy: str) -> list[WorstEpisode]:
    """Falls on the scenarios where the policy falls least, earliest first; then the largest velocity errors."""
    cells = [cell for cell in results.cells if cell.policy == policy]
    cells.sort(key=lambda cell: results.summaries[cell.scenario.name, policy].fall_rate)
    fallen = [each for cell in cells for each in sorted(_of(cell, fell=True), key=lambda each: each.fall_time)]
    upright = [each for cell in cells for each in _of(cell, fell=False)]
    return [*fallen, *sorted(upright, key=lambda each: -each.velocity_error)][:LISTED]


def _of(cell: Cell, *, fell: bool) -> list[WorstEpisode]:
    return [
        WorstEpisode(
            cell.policy,
            cell.scenario.name,
            row,
            int(cell.seeds[row]),
            cell.fall_reason[row],
            float(cell.measures.fall_time[row]),
            float(cell.measures.velocity_error[row]),
        )
        for row in (cell.measures.fell == fell).nonzero()[0].tolist()
    ]


def worst_episodes(results: Results, folder: Path) -> str:
    """The section that lists them, each with the command that replays it."""
    lead = note(
        "Of each policy: falls on the scenarios where it falls least, earliest first; without a fall, the largest "
        "velocity errors. The command runs the episode again, bit for bit on the same class of machine; "
        "--video replay.webp films it."
    )
    heads = ("scenario", "what happened", "replay")
    tables = (
        fold(
            policy_label(results, policy),
            table(heads, [_row(episode, folder) for episode in worst(results, policy)], "text"),
            printed=True,
        )
        for policy in results.policies
    )
    return section("Worst episodes", lead, *tables)


def replay_command(episode: WorstEpisode, folder: Path) -> str:
    """What a shell needs to run the episode again."""
    words = ("python", "-m", "evaluate", "replay", str(folder), str(episode.episode))
    return shlex.join((*words, "--policy", episode.policy, "--scenario", episode.scenario))


def _row(episode: WorstEpisode, folder: Path) -> tuple[str, str, str]:
    what = (
        f"{escape(episode.fall_reason)} at {number(episode.fall_time, 2)} s"
        if episode.fall_reason
        else f"velocity error {number(episode.velocity_error)} m/s"
    )
    return escape(episode.scenario), what, f"<code>{escape(replay_command(episode, folder))}</code>"
