"""Training runs of different settings: `python -m research trials FOLDER…` writes docs/results/trials.csv."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.files.reading import LARGEST, read_bytes
from quad_env.files.writing import write_atomically
from research.pages.csv_text import csv_text
from train.config import DEFAULTS
from train.config_file import flat, to_dict
from train.run_folder import CONFIG_FILE, METRICS_FILE, VALIDATIONS_FILE
from train.run_record import words

_APART = ("policy", "seed", "steps", "validation.")
"""Settings that have a column of their own, or only say how a run was validated."""


@dataclass(frozen=True)
class Options:
    """Which runs, and where their table goes."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs, finished or not, of today's settings or older ones."""
    table: Path = Path("docs/results/trials.csv")
    """CSV file to write."""


@dataclass(frozen=True)
class Tried:
    """What a run's folder says."""

    name: str
    settings: Mapping[str, Any]
    """By the run's own names, as JSON values."""
    steps: int
    """Steps that were made."""
    minutes: float
    best: Mapping[str, Any] | None
    """The best validation; None of a run that was stopped before its first."""


def main(options: Options) -> int:
    """Write the table; the exit code. Raises UsageError."""
    if not options.runs:
        raise UsageError("name the folders of the runs, as in: runs/residual-0 runs/end-to-end-0")
    make_folder_of(options.table, "--table")
    text = csv_text(rows([tried(folder) for folder in options.runs]))
    write_atomically(options.table, text)
    print(text.decode(), end="")
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


def rows(trials: Sequence[Tried]) -> list[dict[str, Any]]:
    """A row for each trial, by kind of policy, the most successful first."""
    found = []
    for kind in DEFAULTS:
        today = dict(flat(to_dict(DEFAULTS[kind])))
        of_kind = [trial for trial in trials if trial.settings["policy"] == kind]
        found += [_row(kind, trial, today) for trial in sorted(of_kind, key=_success, reverse=True)]
    return found


def _success(trial: Tried) -> float:
    return -1.0 if trial.best is None else float(trial.best["success"])


def _row(kind: str, trial: Tried, today: Mapping[str, Any]) -> dict[str, Any]:
    other = [
        f"{name} {words(value) or 'none'}"
        for name, value in flat(trial.settings)
        if not name.startswith(_APART) and today.get(name, ...) != value
    ]
    row = {
        "table": kind,
        "trial": trial.name,
        "settings": ", ".join(other),
        "steps": trial.steps,
        "minutes": f"{trial.minutes:.1f}",
        "judged_on": "stopped",
    }
    if trial.best is not None:
        scenarios, on_flat = trial.best["scenarios"], trial.best["scenarios"].get("flat")
        several = f"{len(scenarios)} scenarios" if len(scenarios) > 3 else ", ".join(scenarios)
        row["judged_on"] = f"{several} x {trial.settings['validation']['episodes']}"
        row["success_percent"] = f"{100.0 * _success(trial):.1f}"
        if on_flat is not None:
            row["flat_success_percent"] = f"{100.0 * on_flat['success_rate']:.0f}"
            row["flat_velocity_error"] = f"{on_flat['velocity_error']:.3f}"
    return row


def best_validation(folder: Path) -> dict[str, Any]:
    """The best of a run's validations. Raises OSError where there are none."""
    found = json.loads(read_bytes(folder / VALIDATIONS_FILE))
    return next(each for each in found["validations"] if each["steps"] == found["best"])


def last_metrics(folder: Path) -> dict[str, Any]:
    """Figures of a run's last rollout. Raises OSError where there are none, IndexError before the first."""
    return dict(json.loads(read_bytes(folder / METRICS_FILE, LARGEST).splitlines()[-1]))
