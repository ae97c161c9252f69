"""The validations of training runs, from their folders; runs that differ in their seed alone together."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from policies.base import Floats
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import LARGEST, read_bytes
from train.config_file import flat, load_settings
from train.run_folder import VALIDATIONS_FILE
from train.run_record import words

LONGEST = 48
"""Characters of a label."""


@dataclass(frozen=True)
class RunCurve:
    """k validations of one run."""

    folder: Path
    settings: Mapping[str, Any]
    """All settings but the seed, by the names of their options."""
    seed: int
    steps: Floats
    """(k,)"""
    figures: Floats
    """Success, share, and cost of transport, NaN where it was not recorded, (2, k)."""


@dataclass(frozen=True)
class SeedBand:
    """Runs of the same settings with different seeds."""

    label: str
    runs: tuple[RunCurve, ...]

    @property
    def steps(self) -> Floats:
        """Steps at which all of the runs were validated, (k,)."""
        return reduce(np.intersect1d, [run.steps for run in self.runs])

    def over_seeds(self) -> tuple[Floats, Floats, Floats]:
        """Mean, lowest and highest of the seeds' figures, each (2, k)."""
        figures = np.array([run.figures[:, np.isin(run.steps, self.steps)] for run in self.runs])
        return figures.mean(axis=0), figures.min(axis=0), figures.max(axis=0)


def read_curve(folder: Path) -> RunCurve:
    """The validations of the run in a folder, of older versions too. Raises UsageError where there is no run."""
    settings, path = dict(flat(load_settings(folder))), folder / VALIDATIONS_FILE
    try:
        entries = json.loads(read_bytes(path, LARGEST))["validations"] if path.exists() else []
        rows = {each["steps"]: (each["steps"], each["success"], each.get("cost_of_transport")) for each in entries}
        columns = np.array(list(rows.values()), np.float64).reshape(-1, 3).T
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{path} holds no validations of a training run: leave that run out") from None
    return RunCurve(folder, settings, settings.pop("seed", 0), columns[0], columns[1:])


def by_seed(runs: Sequence[RunCurve]) -> list[SeedBand]:
    """The runs, those that differ in their seed alone together. Raises UsageError for a seed given twice."""
    groups = dict[str, list[RunCurve]]()
    for run in runs:
        same = groups.setdefault(json.dumps(run.settings, sort_keys=True), [])
        if twice := [each for each in same if each.seed == run.seed]:
            raise UsageError(f"{twice[0].folder} and {run.folder} are both seed {run.seed} of one recipe: name one")
        same.append(run)
    recipes = [each[0].settings for each in groups.values()]
    differ = [name for name in recipes[0] if any(each.get(name) != recipes[0][name] for each in recipes)]
    return [SeedBand(_label(each, differ or ["policy", "base"]), tuple(each)) for each in groups.values()]


def _label(runs: Sequence[RunCurve], options: Sequence[str]) -> str:
    """These settings of the runs, or where that is too long the first one's folder; and how many seeds."""
    said = ", ".join(f"{name} {words(runs[0].settings.get(name))}" for name in options)
    seeds = f"{len(runs)} seeds" if len(runs) > 1 else f"seed {runs[0].seed}"
    return f"{said if len(said) <= LONGEST else runs[0].folder} ({seeds})"
