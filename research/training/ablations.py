"""What each choice in the training is worth: `python -m research ablations` writes docs/ablations.md.

Every variant differs from the default command in what its name says, and trains for as many steps from the same seeds.
All are judged by their best validation, on episodes and ground that no evaluation uses. A study that was stopped goes
on where it was: finished runs in --out are kept.
"""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evaluate.statistics.intervals import CONFIDENCE
from policies.base import Floats
from policies.parameters import limits_of, number
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically
from train.command import parse
from train.config import DEFAULTS, Count, TrainConfig, differences, load_config
from train.run_folder import VALIDATIONS_FILE, has_checkpoint, steps_done
from train.run_record import last_metrics

DEFAULT = "default"
VARIANTS: Mapping[str, str] = {
    DEFAULT: "",
    "base: trot": "--base trot",
    "base: trot_feedback": "--base trot_feedback --ppo.learning-rate 4e-4 --ppo.log-std-init -2.3",
    "no memory": "--inputs.lags --inputs.averages",
    "no slope far from the command": "--rewards linear-velocity-error=0 yaw-rate-error=0",
    "corrections at 100 Hz": "--ppo.hold 1 --ppo.gamma 0.99",
    "horizon of 0.4 s": "--ppo.gamma 0.95",
    "authority of 0.6 rad": "--joint-authority 0.6 --hip-authority 0.3",
    "three scenarios": "--mixture flat 0.6 push 0.2 rough 0.2",
    "gentler updates": "--ppo.learning-rate 4e-4",
    "a rate that stays": "--ppo.learning-rate-schedule constant",
    "more, smaller updates": "--ppo.envs 256 --ppo.minibatch 1024 --ppo.epochs 4",
    "noise of 0.1": "--ppo.log-std-init -2.3",
    "a fall costs 1": "--rewards fall=-1",
    "no curriculum": "--curriculum 1",
}
"""Name of each variant -> the options in which it differs from the default command."""
HEADER = (
    "| variant | options | success of each seed, % | median | minus default, points | flat error, m/s | time, min |",
    "|---|---|---|---|---|---|---|",
)


@dataclass(frozen=True)
class Options:
    """What is compared, and how thoroughly."""

    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of the variants."""
    steps: Count = number(1_000_000, limits=(1, 10**12 - 1))
    """Steps of each run."""
    seeds: int = number(5, limits=(2, 1000))
    """Training seeds of each variant, from 0 on."""
    episodes: int = number(24, limits=(1, 100_000))
    """Episodes a scenario on which a run is judged."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation."""
    out: Path = Path("runs/ablations")
    """Folder of the runs; finished ones of the same settings are kept."""
    page: Path = Path("docs/ablations.md")
    """Where the table goes."""


@dataclass(frozen=True)
class Found:
    """The runs of a variant, seed after seed."""

    name: str
    success: tuple[float, ...]
    """Mean over the scenarios, %."""
    flat_error: tuple[float, ...]
    """Velocity error on flat ground, m/s."""
    minutes: tuple[float, ...]


def main(options: Options) -> int:
    """Train what has not been trained yet, then write the page; the exit code. Raises UsageError."""
    check_numbers(options, limits_of(options))
    if unknown := [name for name in options.variants if name not in VARIANTS]:
        raise UsageError(f"--variants: unknown {unknown[0]!r}; valid: {', '.join(map(repr, VARIANTS))}")
    raise_on_interrupt()
    names = (DEFAULT, *(name for name in options.variants if name != DEFAULT))
    runs = {name: [config(options, name, seed) for seed in range(options.seeds)] for name in names}
    # Seed by seed, so that a study that is stopped has compared all variants on the seeds that it came to.
    for seed in range(options.seeds):
        for name in names:
            print(f"{name}, seed {seed}", flush=True)
            finish(runs[name][seed])
    text = page(options, [found(name, runs[name]) for name in names])
    write_atomically(options.page, text.encode())
    print(text, end="")
    return 0


def judged_scenarios() -> tuple[str, ...]:
    """Those that the default trains on, whatever a variant trains on."""
    return DEFAULTS["residual"].complete_validation.scenarios


def config(options: Options, name: str, seed: int) -> TrainConfig:
    """Settings of one run."""
    words = f"{VARIANTS[name]} --steps {options.steps} --seed {seed} --threads {options.threads}".split()
    words += ["--validation.interval", "0", "--validation.episodes", str(options.episodes)]
    words += ["--validation.scenarios", *judged_scenarios()]
    folder = "".join(letter if letter.isalnum() else "-" for letter in name)
    return replace(parse(words), out=options.out / folder / f"seed-{seed}")


def finish(run: TrainConfig) -> None:
    """Train to the end what is not there yet. Raises UsageError where the folder holds another run."""
    from train.run import train

    resume = has_checkpoint(run.folder)
    if resume and (others := differences(load_config(run.folder), run)):
        raise UsageError(f"{run.folder} holds a run of other settings ({others[0]}); choose another --out")
    if steps_done(run.folder) < run.steps or not (run.folder / VALIDATIONS_FILE).exists():
        train(replace(run, resume=resume))


def found(name: str, runs: Sequence[TrainConfig]) -> Found:
    """What finished runs came to."""
    last = [json.loads(read_bytes(run.folder / VALIDATIONS_FILE))["validations"][-1] for run in runs]
    seconds = [last_metrics(run.folder)["time/seconds"] for run in runs]
    return Found(
        name,
        tuple(100.0 * each["success"] for each in last),
        tuple(each["scenarios"]["flat"]["velocity_error"] for each in last),
        tuple(second / 60.0 for second in seconds),
    )


def page(options: Options, variants: Sequence[Found]) -> str:
    """The table of all variants, in Markdown; the default is the first."""
    default = variants[0]
    scenarios = config(options, DEFAULT, 0).validation.scenarios
    lines = [
        "# What each choice of the training is worth",
        "",
        f"Written by `python -m research ablations --steps {options.steps} --seeds {options.seeds} "
        f"--episodes {options.episodes}{_chosen(variants)}`: each variant differs from the default command, "
        "`python -m train`, in the "
        f"options shown alone, and trains {options.steps:,} steps from each of {options.seeds} seeds. Success is the "
        f"mean over {len(scenarios)} scenarios ({', '.join(scenarios)}), {options.episodes} validation episodes each; "
        "no evaluation uses these. Differences are of means over seeds, in percentage points, with 95 % intervals over "
        "seeds, not corrected for their number.",
        "",
        *HEADER,
        *(_row(each, default) for each in variants),
    ]
    return "\n".join(lines) + "\n"


def _chosen(variants: Sequence[Found]) -> str:
    """The option that names the variants, where it is not all of them."""
    names = [each.name for each in variants]
    return "" if set(names) == set(VARIANTS) else f" --variants {' '.join(map(repr, names))}"


def _row(each: Found, default: Found) -> str:
    success, reference = np.array(each.success), np.array(default.success)
    against = "" if each is default else _difference(success, reference)
    cells = (
        each.name,
        f"`{VARIANTS[each.name]}`" if VARIANTS[each.name] else "",
        ", ".join(f"{value:.1f}" for value in each.success),
        f"{np.median(success):.1f}",
        against,
        f"{np.median(each.flat_error):.3f}",
        f"{np.median(each.minutes):.1f}",
    )
    return f"| {' | '.join(cells)} |"


def _difference(a: Floats, b: Floats) -> str:
    """Mean of a less that of b, with the interval of Welch's test: resampling five seeds would make it too narrow."""
    from scipy.stats import ttest_ind

    difference = f"{a.mean() - b.mean():+.1f}"
    if np.ptp(a) == np.ptp(b) == 0.0:
        return difference
    with warnings.catch_warnings():  # of one variant whose seeds are all alike
        warnings.simplefilter("ignore", RuntimeWarning)
        low, high = ttest_ind(a, b, equal_var=False).confidence_interval(CONFIDENCE)
    return f"{difference} ({low:+.1f} … {high:+.1f})"
