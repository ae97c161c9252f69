"""Learning curves of training runs, and their means over the seeds of one recipe."""

import json
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.records.training_run import VALIDATIONS_FILE, load_settings
from evaluate.statistics.intervals import CONFIDENCE, Floats
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes

MAX_LABEL_LENGTH = 48
"""Maximum length of the training settings in the label of a curve, characters.

If the settings are longer, the label shows the folder of a training run instead.
"""
LIMITS = np.array([[0.0, 1.0], [0.0, np.inf]])
"""Smallest and largest possible value of success rate (row 0) and cost of transport (row 1), (2, 2)."""


@dataclass(frozen=True)
class RunCurve:
    """Learning curve of one training run, made by `read_curve`."""

    folder: Path
    """Folder of the training run."""
    settings: Mapping[str, Any]
    """Training settings except the seed: name of the option -> value."""
    seed: int
    """Seed of the training run."""
    steps: Floats
    """Number of training steps before each of the k validations, (k,)."""
    figures: Floats
    """Results of the k validations, (2, k): first row success rate, 0 to 1; second row cost of transport.

    The cost of transport is NaN if it was not recorded.
    """


@dataclass(frozen=True)
class SeedBand:
    """Group of training runs with the same settings and different seeds, made by `group_by_seed`."""

    label: str
    """Label of the group in the legend of the plot."""
    runs: tuple[RunCurve, ...]
    """Learning curves of the training runs, one for each seed."""

    @property
    def steps(self) -> Floats:
        """Numbers of training steps, (k,), at which all training runs of the group were validated."""
        return reduce(np.intersect1d, [run.steps for run in self.runs])

    @property
    def figures(self) -> Floats:
        """Results of the s training runs at `steps`, (s, 2, k), with the rows of `RunCurve.figures`."""
        return np.array([run.figures[:, np.isin(run.steps, self.steps)] for run in self.runs])

    def over_seeds(self) -> tuple[Floats, Floats, Floats]:
        """Compute mean, minimum and maximum over the seeds, at the common validations of all training runs.

        Returns:
            Three arrays, mean, minimum and maximum, each (2, k) for the k numbers of training steps in `steps`. The
            first row is the success rate, 0 to 1; the second row is the cost of transport.
        """
        figures = self.figures
        return figures.mean(axis=0), figures.min(axis=0), figures.max(axis=0)

    def mean_interval(self) -> tuple[Floats, Floats]:
        """Compute the 95 % interval of the mean over the seeds, by Student's t, within the possible values.

        Returns:
            low: Lower end at each validation, (2, k), with the rows of `RunCurve.figures`; NaN for a single seed.
            high: Upper end, (2, k).
        """
        from scipy.special import stdtrit

        figures = self.figures
        seeds = len(figures)
        mean = figures.mean(axis=0)
        if seeds == 1:
            return np.full_like(mean, np.nan), np.full_like(mean, np.nan)
        half = float(stdtrit(seeds - 1, 0.5 + CONFIDENCE / 2)) * figures.std(axis=0, ddof=1) / np.sqrt(seeds)
        return np.maximum(mean - half, LIMITS[:, :1]), np.minimum(mean + half, LIMITS[:, 1:])


def read_curve(folder: Path) -> RunCurve:
    """Read the learning curve of a training run, which may be of an older version of this project.

    Args:
        folder: Folder of the training run.

    Returns:
        The learning curve; its arrays are empty if the training run has no validation yet.

    Raises:
        UsageError: The folder contains no training run, or the file of the validations is damaged.
    """
    settings = dict(_flatten(load_settings(folder)))
    path = folder / VALIDATIONS_FILE
    try:
        entries = json.loads(read_bytes(path, MAX_DATA_SIZE))["validations"] if path.exists() else []
        rows = {entry["steps"]: (entry["steps"], entry["success"], entry.get("cost_of_transport")) for entry in entries}
        columns = np.array(list(rows.values()), np.float64).reshape(-1, 3).T
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{path} holds no validations of a training run: leave that run out") from None
    return RunCurve(folder, settings, settings.pop("seed", 0), columns[0], columns[1:])


def group_by_seed(runs: Sequence[RunCurve]) -> list[SeedBand]:
    """Group the training runs that differ only in their seed.

    Args:
        runs: Learning curves of all training runs.

    Returns:
        One group for each combination of settings, with a label for the legend.

    Raises:
        UsageError: Two training runs of a group have the same seed.
    """
    groups = dict[str, list[RunCurve]]()
    for run in runs:
        group = groups.setdefault(json.dumps(run.settings, sort_keys=True), [])
        if same_seed := [other for other in group if other.seed == run.seed]:
            raise UsageError(f"{same_seed[0].folder} and {run.folder} are both seed {run.seed} of one recipe: name one")
        group.append(run)
    recipes = [group[0].settings for group in groups.values()]
    differing = [name for name in recipes[0] if any(recipe.get(name) != recipes[0][name] for recipe in recipes)]
    return [SeedBand(_label(group, differing or ["policy", "base"]), tuple(group)) for group in groups.values()]


def read_bands(folders: Sequence[Path]) -> list[SeedBand]:
    """Read the learning curves of training runs, and group the runs that differ only in their seed.

    A run without a validation is left out, and a line on stderr names it.

    Args:
        folders: Folders of the training runs.

    Returns:
        One group for each combination of settings.

    Raises:
        UsageError: No run has a validation, a folder has no run, or two runs of a group have the same seed.
    """
    runs = [read_curve(folder) for folder in folders]
    for run in runs:
        if not len(run.steps):
            print(f"{run.folder} has no validation yet: left out", file=sys.stderr)
    validated = [run for run in runs if len(run.steps)]
    if not validated:
        raise UsageError("no run with a validation to draw: name the folders of training runs, such as runs/residual-0")
    return group_by_seed(validated)


def _label(runs: Sequence[RunCurve], options: Sequence[str]) -> str:
    """Return the label of a group of training runs, for example `base trot (5 seeds)`.

    If the values of the options are too long, the label has the folder of the first training run instead.

    Args:
        runs: Learning curves of the group.
        options: Names of the options that the label shows with their values.

    Returns:
        The label.
    """
    settings = ", ".join(f"{name} {_words(runs[0].settings.get(name))}" for name in options)
    seeds = f"{len(runs)} seeds" if len(runs) > 1 else f"seed {runs[0].seed}"
    return f"{settings if len(settings) <= MAX_LABEL_LENGTH else runs[0].folder} ({seeds})"


def _flatten(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name of each option, such as `ppo.envs`, and its value from nested `settings`; `prefix`: `ppo.`."""
    for key, value in settings.items():
        name = prefix + key.replace("_", "-")
        if isinstance(value, dict):
            yield from _flatten(value, f"{name}.")
        else:
            yield name, value


def _words(value: Any) -> str:
    """Return the JSON `value` of a setting as the text after its option on a command line."""
    return " ".join(_words(entry) for entry in value) if isinstance(value, list) else shlex.quote(str(value))
