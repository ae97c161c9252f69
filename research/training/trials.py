"""Trials of settings beside each other: `python -m research trials FOLDER…` writes docs/trials.md from their runs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically
from train.config import DEFAULTS, flat, to_dict
from train.run_folder import CONFIG_FILE, METRICS_FILE, VALIDATIONS_FILE
from train.run_record import best_validation, last_metrics, words

HEADER = (
    "| trial | settings other than today's defaults | steps | time, min | judged on | success, % | flat: success, % | "
    "flat: velocity error, m/s |",
    "|---|---|---|---|---|---|---|---|",
)
_APART = ("policy", "seed", "steps", "validation.")
"""Settings that have a column of their own, or say no more than how a run was watched."""


@dataclass(frozen=True)
class Options:
    """Which runs, and where their table goes."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs, finished or not, of today's settings or older ones."""
    page: Path = Path("docs/trials.md")
    """Where the table goes."""


@dataclass(frozen=True)
class Tried:
    """A run as its folder tells of it."""

    name: str
    settings: Mapping[str, Any]
    """By the run's own names, as JSON values."""
    steps: int
    """Steps that were made."""
    minutes: float
    best: Mapping[str, Any] | None
    """The best validation; None of a run that was stopped before its first."""


def main(options: Options) -> int:
    """Write the page; the exit code. Raises UsageError."""
    if not options.runs:
        raise UsageError("name the folders of the runs, as in: runs/residual-0 runs/end-to-end-0")
    text = page([tried(folder) for folder in options.runs])
    write_atomically(options.page, text.encode())
    print(text, end="")
    return 0


def tried(folder: Path) -> Tried:
    """What a run's folder says. Raises UsageError where there is no run."""
    try:
        settings = json.loads(read_bytes(folder / CONFIG_FILE))
        last = last_metrics(folder)
    except (OSError, ValueError, IndexError):
        raise UsageError(f"no run in {folder}: {CONFIG_FILE} and {METRICS_FILE} cannot be read") from None
    best = best_validation(folder) if (folder / VALIDATIONS_FILE).exists() else None
    return Tried(folder.name, settings, last["steps"], last["time/seconds"] / 60.0, best)


def page(trials: Sequence[Tried]) -> str:
    """The tables of all trials, one for each kind of policy, the most successful first; in Markdown."""
    lines = [
        "# Trials of the training's settings",
        "",
        "Written by `python -m research trials` from the folders of the runs, also of those that found nothing. Each "
        "was judged by its best validation, on episodes that no evaluation uses: the mean over the scenarios that it "
        "names. Times are those of a machine that may have had other work. A setting that is not there any more stands "
        "under the name that it had; bases may have been searched anew since.",
    ]
    for kind in DEFAULTS:
        of_kind = [trial for trial in trials if trial.settings["policy"] == kind]
        if of_kind:
            today = dict(flat(to_dict(DEFAULTS[kind])))
            rows = [_row(trial, today) for trial in sorted(of_kind, key=_success, reverse=True)]
            lines += ["", f"## {kind}", "", *HEADER, *rows]
    return "\n".join(lines) + "\n"


def _success(trial: Tried) -> float:
    return -1.0 if trial.best is None else float(trial.best["success"])


def _row(trial: Tried, today: Mapping[str, Any]) -> str:
    other = [
        f"{name} {words(value) or 'none'}"
        for name, value in flat(trial.settings)
        if not name.startswith(_APART) and today.get(name, ...) != value
    ]
    judged = ["", "stopped", "", ""]
    if trial.best is not None:
        scenarios, on_flat = trial.best["scenarios"], trial.best["scenarios"].get("flat")
        several = f"{len(scenarios)} scenarios" if len(scenarios) > 3 else ", ".join(scenarios)
        judged = [
            f"{several} × {trial.settings['validation']['episodes']}",
            f"{100.0 * _success(trial):.1f}",
            *(["", ""] if on_flat is None else _on_flat(on_flat)),
        ]
    cells = (trial.name, ", ".join(other), f"{trial.steps:,}", f"{trial.minutes:.1f}", *judged)
    return f"| {' | '.join(cells)} |"


def _on_flat(means: Mapping[str, float]) -> list[str]:
    return [f"{100.0 * means['success_rate']:.0f}", f"{means['velocity_error']:.3f}"]
