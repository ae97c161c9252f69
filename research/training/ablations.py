"""Ablation study of the training: `python -m research ablations` measures the effect of each choice.

The results are written to docs/results/ablations.csv and .png. Every variant of the training changes one choice of the
default command; the name of the variant describes this choice. All variants train for the same number of steps with the
same seeds. Success is the success rate in the last validation, on episodes and ground that no evaluation uses. The
command can be stopped and repeated: finished runs in --out are kept.
"""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.report.plots import drawing
from evaluate.statistics.intervals import CONFIDENCE
from policies.base import Floats
from policies.parameters import limits_of, parameter
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from quad_env.files.writing import write_atomically
from research.pages.csv_text import to_csv
from research.pages.evaluations import figure_to_png
from train.commands.run import parse
from train.config import DEFAULTS, TrainConfig
from train.run_folder import METRICS_FILE, VALIDATIONS_FILE, has_checkpoint, steps_done
from train.run_record import differences, load_config

DEFAULT = "default"
"""Name of the variant that trains with the default options; all other variants are compared with it."""
VARIANTS: Mapping[str, str] = {
    DEFAULT: "",
    "base: trot": "--base trot",
    "base: trot_integral": "--base trot_integral",
    "base: stand": "--base stand",
    "sighted": "--sighted",
    "domain randomisation": "--mixture flat:2+randomised 0.6 push:3+randomised 0.2 rough:3+randomised 0.2",
    "no effort": "--rewards.mechanical-power 0 --rewards.action-rate 0 --rewards.torque 0",
    "effort in full from the start": "--effort-ramp 0",
    "twice the power weight": "--rewards.mechanical-power -0.005",
    "no crouch term": "--rewards.crouch 0",
    "no memory": "--inputs.lags --inputs.averages",
    "no slope far from the command": "--rewards.linear-velocity-error 0 --rewards.yaw-rate-error 0",
    "corrections at 100 Hz": "--ppo.hold 1 --ppo.gamma 0.99",
    "authority of 0.3 rad": "--joint-authority 0.3 --hip-authority 0.15",
    "three scenarios": "--mixture flat:2 0.6 push:3 0.2 rough:3 0.2",
    "a rate that falls linearly": "--ppo.learning-rate-schedule linear",
    "fewer robots, smaller minibatches": "--ppo.envs 512 --ppo.minibatch 2048",
    "no curriculum": "--curriculum 1",
}
"""Name of a variant of the training -> command-line options that it adds to the default command."""
VALIDATED_ON = DEFAULTS["residual"].complete_validation.scenarios
"""Scenarios for the validation of all variants: the training scenarios of the variant `default`."""


@dataclass(frozen=True)
class AblationsOptions:
    """Options of the command `ablations`: variants of the training, numbers of steps, seeds and episodes."""

    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of the variants of the training that are compared."""
    steps: int = parameter(1_000_000, limits=(1, 10**12 - 1))
    """Number of training steps of each training run."""
    seeds: int = parameter(5, limits=(2, 1000))
    """Number of training seeds of each variant; the seeds are 0, 1, …."""
    episodes: int = parameter(24, limits=(1, 100_000))
    """Number of validation episodes on each scenario."""
    threads: int = parameter(2, limits=(1, 256))
    """Number of threads of the simulation."""
    out: Path = Path("runs/ablations")
    """Folder of the training runs; finished runs with the same settings are not repeated."""
    table: Path = Path("docs/results/ablations.csv")
    """CSV file for the results; the plot is written next to it, as a PNG file of the same name."""


def main(options: AblationsOptions) -> int:
    """Run the command `ablations`: train the missing runs, and write table and plot of the results.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: A variant is unknown, or another option is invalid.
    """
    check_numbers(options, limits_of(options))
    if unknown := [name for name in options.variants if name not in VARIANTS]:
        raise UsageError(f"--variants: unknown {unknown[0]!r}; valid: {', '.join(map(repr, VARIANTS))}")
    make_folder_of(options.table, "--table")
    raise_on_interrupt()
    names = (DEFAULT, *(name for name in options.variants if name != DEFAULT))
    runs = {name: [make_config(options, name, seed) for seed in range(options.seeds)] for name in names}
    # The outer loop is over seeds, so that a study that is stopped early has complete seeds of all variants.
    for seed in range(options.seeds):
        for name in names:
            print(f"{name}, seed {seed}", flush=True)
            train_missing(runs[name][seed])
    table = make_rows({name: list(map(read_results, runs[name])) for name in names})
    write_atomically(options.table, to_csv(table))
    draw_differences(table, options.table.with_suffix(".png"))
    print(to_csv(table).decode(), end="")
    return 0


def make_config(options: AblationsOptions, name: str, seed: int) -> TrainConfig:
    """Create the training settings of one variant and one seed.

    Args:
        options: Options of the command.
        name: Name of the variant.
        seed: Training seed.

    Returns:
        Training settings, including the folder of the training run.
    """
    arguments = f"{VARIANTS[name]} --steps {options.steps} --seed {seed} --threads {options.threads}".split()
    arguments += ["--validation.interval", "0", "--validation.episodes", str(options.episodes)]
    arguments += ["--validation.scenarios", *VALIDATED_ON]
    folder = "".join(letter if letter.isalnum() else "-" for letter in name)
    return replace(parse(arguments), out=options.out / folder / f"seed-{seed}")


def train_missing(run: TrainConfig) -> None:
    """Train a run, or continue it if it is unfinished; do nothing if it is finished.

    Args:
        run: Training settings, including the folder of the run.

    Raises:
        UsageError: The folder contains a training run with other settings.
    """
    from train.run import train

    resume = has_checkpoint(run.folder)
    if resume and (others := differences(load_config(run.folder), run)):
        raise UsageError(f"{run.folder} holds a run of other settings ({others[0]}); choose another --out")
    if steps_done(run.folder) < run.steps or not (run.folder / VALIDATIONS_FILE).exists():
        train(replace(run, resume=resume))


def read_results(run: TrainConfig) -> dict[str, float]:
    """Read the results of a finished training run.

    Args:
        run: Training settings, including the folder of the run.

    Returns:
        Dictionary: `success`, success rate of the last validation, %; `flat_velocity_error`, velocity error on the
        scenario `flat:2` in this validation, m/s; `minutes`, training time, min.
    """
    last = json.loads(read_bytes(run.folder / VALIDATIONS_FILE))["validations"][-1]
    metrics = json.loads(read_bytes(run.folder / METRICS_FILE, MAX_DATA_SIZE).splitlines()[-1])
    return {
        "success": 100.0 * last["success"],
        "flat_velocity_error": last["scenarios"]["flat:2"]["velocity_error"],
        "minutes": metrics["time/seconds"] / 60.0,
    }


def make_rows(variants: Mapping[str, Sequence[Mapping[str, float]]]) -> list[dict[str, Any]]:
    """Create the rows of the table of results, one row per variant.

    Args:
        variants: Name of a variant -> results from `read_results` for each seed.

    Returns:
        Rows: name of the column -> value. A row has the success rate of each seed, %, and its median over the seeds.
        Except for the default variant, a row also has the mean success rate minus the mean success rate of the default
        variant, percentage points.
    """
    success = {name: np.array([run["success"] for run in runs]) for name, runs in variants.items()}
    rows = []
    for name, runs in variants.items():
        row: dict[str, Any] = {
            "variant": name,
            "options": VARIANTS[name],
            "success_by_seed_percent": " ".join(f"{value:.1f}" for value in success[name]),
            "median_percent": float(np.median(success[name])),
        }
        if name != DEFAULT:
            row |= _difference(success[name], success[DEFAULT])
        row |= {
            figure: float(np.median([run[figure] for run in runs])) for figure in ("flat_velocity_error", "minutes")
        }
        rows.append(row)
    return rows


def _difference(a: Floats, b: Floats) -> dict[str, float]:
    """Compute the difference of the mean success rates of two variants, with Welch's t-interval.

    A bootstrap interval is not used, because it is too narrow with five seeds.

    Args:
        a: Success rate of the first variant with each seed, (seeds,), %.
        b: Success rate of the second variant with each seed, (seeds,), %.

    Returns:
        Name of the column -> value, percentage points: the difference, and the bounds `low` and `high` of its 95 %
        interval. The bounds are missing if the success rate of each variant is the same with all seeds.
    """
    from scipy.stats import ttest_ind

    difference = {"minus_default_points": float(a.mean() - b.mean())}
    if np.ptp(a) == np.ptp(b) == 0.0:
        return difference
    # The warnings are ignored, because SciPy warns if all seeds of a variant have the same result.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        low, high = ttest_ind(a, b, equal_var=False).confidence_interval(CONFIDENCE)
    return difference | {"low": float(low), "high": float(high)}


def draw_differences(table: Sequence[Mapping[str, Any]], picture: Path) -> None:
    """Plot the success rate of each variant minus the success rate of the default, with its 95 % interval.

    Args:
        table: Rows from `make_rows`.
        picture: PNG file to write.
    """
    rows = [row for row in table if row.get("minus_default_points") is not None]
    left = 0.2 + max(map(drawing.text_width, (row["variant"] for row in rows)), default=0.0)
    with drawing.plot_settings():
        figure, axes = drawing.make_figure(0.6 + 0.2 * len(rows), left + 3.2, drawing.Margins(left=left))
        for line, row in enumerate(rows):
            if row.get("low") is not None:
                axes.plot((row["low"], row["high"]), (line, line), color=drawing.COLOURS[0], linewidth=1.4)
            axes.plot(row["minus_default_points"], line, "o", color=drawing.COLOURS[0], markersize=4)
        axes.axvline(0.0, color="black", linewidth=0.8)
        axes.set_yticks(range(len(rows)), [row["variant"] for row in rows])
        axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel="success minus the default's, % points")
        write_atomically(picture, figure_to_png(figure))
