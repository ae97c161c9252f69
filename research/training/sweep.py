"""A search of training's settings by Optuna: each trial is a run in its own folder, ranked by its best validation.

    python -m research sweep --steps 1e6 --trials 30 --ranges ppo.learning-rate 1e-4 3e-3 ppo.gamma 0.9 0.99

All trials have the same seed and steps, and start from the settings of --policy, or those of the run in --like. The
settings of a trial depend on --seed and the earlier trials alone, so a resumed sweep equals an uninterrupted one.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from policies.parameters import limits_of, number
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.files.writing import make_writable_folder, sole_use, write_atomically
from research.pages import markdown
from research.training.trials import best_validation
from train.config import DEFAULTS, PolicyKind, TrainConfig
from train.config_file import load_config, to_dict
from train.option_types import Count
from train.run_folder import has_checkpoint, steps_done
from train.setting_ranges import check

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial, Trial

JOURNAL, TABLE = "journal.log", "trials.md"
"""Optuna's storage, and the trials as a table, in the sweep's folder."""
FAILURES = 1000.0
"""Cost of a failure rate of 1, m/s of error: success decides, and the error only between equal rates."""
RANGES = (
    ("ppo.learning_rate", 1e-4, 3e-3),
    ("ppo.gamma", 0.9, 0.995),
    ("ppo.gae_lambda", 0.8, 0.98),
    ("ppo.epochs", 2, 10),
    ("ppo.log_std_init", -3.0, -0.5),
)


@dataclass(frozen=True)
class Options:
    """Which settings to search, and for how long."""

    ranges: tuple[tuple[str, float, float], ...] = RANGES
    """Settings of `python -m train` that are searched, each from its least to its largest value; where these are ten
    times apart, on a logarithmic scale."""
    trials: int = number(20, limits=(1, 100_000))
    """Runs, those of earlier sessions among them."""
    steps: Count = number(1_000_000, limits=(1, 10**12 - 1))
    """Steps of each run."""
    policy: PolicyKind = "residual"
    """Whose defaults the settings start from."""
    like: Path | None = None
    """Folder of a run whose settings they start from instead."""
    seed: int = number(0, limits=(0, 2**31))
    """Seed of the search and of every run."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation."""
    out: Path = Path("runs/sweep")
    """Folder of the sweep; must be new, unless --resume."""
    resume: bool = False
    """Carry on the sweep in --out, with the options that it was begun with; a larger --trials extends it."""


def main(options: Options) -> int:
    """Run the trials that are left, then print the table of all; the exit code. Raises UsageError."""
    check_numbers(options, limits_of(options))
    like = load_config(options.like) if options.like else DEFAULTS[options.policy]
    start = dataclasses.replace(like, steps=options.steps, seed=options.seed, threads=options.threads)
    for end in (1, 2):
        check(changed(start, {each[0]: each[end] for each in options.ranges}))
    if (options.out / JOURNAL).exists() is not options.resume:
        how = "holds no sweep: begin one without --resume" if options.resume else "holds a sweep: add --resume"
        raise UsageError(f"{options.out} {how}, or choose another --out")
    raise_on_interrupt()
    make_writable_folder(options.out)
    with sole_use(options.out):
        study = _study(options, start)
        try:
            for trial in _left(study, options, start):
                _run(study, trial, options, start)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("carry the sweep on with the same options and --resume") from None
        text = table(study.trials, options.out) + "\n"
        write_atomically(options.out / TABLE, text.encode())
    print(text, end="")
    return 0


def changed(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    """The configuration with other values of settings, by names such as `ppo.gamma`. Raises UsageError."""

    def change(part: Any, setting: tuple[str, Any]) -> Any:
        (first, _, rest), value = setting[0].replace("-", "_").partition("."), setting[1]
        old = getattr(part, first, None)
        if rest and dataclasses.is_dataclass(old):
            return dataclasses.replace(part, **{first: change(old, (rest, value))})
        if rest or type(old) not in (int, float):
            raise UsageError(f"--ranges: {setting[0]} is no number among the settings; see `python -m train --help`")
        return dataclasses.replace(part, **{first: int(value) if type(old) is int else float(value)})

    found: TrainConfig = reduce(change, values.items(), config)
    return found


def distributions(options: Options, start: TrainConfig) -> "dict[str, BaseDistribution]":
    """Optuna's distributions of the settings, whole numbers where the settings are."""
    from optuna.distributions import FloatDistribution, IntDistribution

    whole = {name: changed(start, {name: 0.0}) == changed(start, {name: 0.5}) for name, low, _ in options.ranges}
    return {
        name: IntDistribution(int(low), int(high), log=0 < 10 * low <= high)
        if whole[name]
        else FloatDistribution(low, high, log=0 < 10 * low <= high)
        for name, low, high in options.ranges
    }


def _study(options: Options, start: TrainConfig) -> "Study":
    """The study in the sweep's folder, of these settings. Raises UsageError where it is of others."""
    try:
        import optuna
        from optuna.storages.journal import JournalFileBackend
    except ImportError:
        raise UsageError('sweep wants Optuna: pip install -e ".[sweep]"') from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = optuna.storages.JournalStorage(JournalFileBackend(str(options.out / JOURNAL)))
    study = optuna.create_study(storage=storage, study_name="sweep", direction="minimize", load_if_exists=True)
    settings = {"start": to_dict(start), "ranges": [list(each) for each in options.ranges]}
    if study.user_attrs.setdefault("settings", settings) != settings:
        raise UsageError(f"the sweep in {options.out} was begun with other options: only --trials may be larger")
    study.set_user_attr("settings", settings)
    return study


def _left(study: "Study", options: Options, start: TrainConfig) -> "Iterator[Trial | FrozenTrial]":
    """The trials that are to be run: one that was interrupted, then new ones."""
    from optuna.samplers import TPESampler
    from optuna.trial import TrialState

    space = distributions(options, start)
    for trial in study.get_trials(states=(TrialState.RUNNING,)):
        if set(trial.params) == set(space):
            yield trial
        else:  # killed while it was drawn
            study.tell(trial.number, state=TrialState.FAIL)
    while (made := len(study.get_trials(states=(TrialState.COMPLETE, TrialState.FAIL)))) < options.trials:
        study.sampler = TPESampler(seed=options.seed + made)  # a sampler of another session goes on where it would
        yield study.ask(space)


def _run(study: "Study", trial: "Trial | FrozenTrial", options: Options, start: TrainConfig) -> None:
    """Train a trial to its end and report its cost; a trial that cannot be trained has failed."""
    # Only now, so that --help and mistakes answer at once: torch takes seconds to import.
    from optuna.trial import TrialState

    from train.run import train

    folder = _folder_of(trial, options.out)
    config = dataclasses.replace(changed(start, trial.params), out=folder, resume=has_checkpoint(folder))
    values = "  ".join(f"{name} {value:.4g}" for name, value in trial.params.items())
    print(f"trial {trial.number}: {values}", flush=True)
    try:
        if steps_done(folder) < config.steps:
            train(config)
    except ValueError as error:  # such as weights that are no numbers
        print(f"trial {trial.number} failed: {str(error).splitlines()[0]}", flush=True)
        study.tell(trial.number, state=TrialState.FAIL)
        return
    study.tell(trial.number, cost(folder))


def cost(folder: Path) -> float:
    """Cost of a trial, which the search minimises: failures first, then the velocity error."""
    found = best_validation(folder)
    return float(FAILURES * (1.0 - found["success"]) + found["score"])


def table(trials: "list[FrozenTrial]", folder: Path) -> str:
    """The trials in Markdown, the best first, those that failed last."""
    rows = []
    for trial in sorted(trials, key=lambda trial: float("inf") if trial.value is None else trial.value):
        run = _folder_of(trial, folder)
        found = None if trial.value is None else best_validation(run)
        success, error = ("failed", "") if found is None else (f"{found['success']:.1%}", f"{found['score']:.3f}")
        settings = {name: f"{value:.4g}" for name, value in trial.params.items()}
        rows.append({"run": run.name, "success": success, "error, m/s": error, **settings})
    return markdown.table({name: name for name in rows[0]}, rows)


def _folder_of(trial: "Trial | FrozenTrial", folder: Path) -> Path:
    return folder / f"trial-{trial.number:04d}"
