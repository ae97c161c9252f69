"""`python -m benchmarks.training`: where training's time goes, and how long it takes until the policy is good.

Good is the velocity error on flat ground, judged by the validation code on episodes that training never sees. The clock
stands still during a judgement. The untrained residual is its base, the trot, and is judged first: a time of nearly
nothing says that the base is good enough. Every judgement is kept in training.json under --out; a finished seed is not
measured again on the same committed revision.
"""

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from benchmarks.support.bars import THRESHOLDS, Check, check
from benchmarks.support.command import Common, Outcome, command, plain, table
from benchmarks.support.measure import cores, machine
from benchmarks.support.progress import stage
from evaluate.records.provenance import REPOSITORY, git_revision
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import launch
from quad_env.files.writing import make_writable_folder, write_atomically
from train.config import DEFAULTS, PolicyKind, PpoConfig, TrainConfig, to_dict

if TYPE_CHECKING:
    from benchmarks.probes.training_run import Judgement, Shares

FILE = "training.json"
SEEDS = 5
"""Training seeds of the median that the bars are for."""


@dataclass(frozen=True)
class Options(Common):
    """Shares of the wall time, steps a second, and seconds to each velocity error."""

    policy: PolicyKind = "residual"
    """What is trained, with the defaults of `python -m train`."""
    seeds: int = SEEDS
    """Seeds, from 0 on (count); 0 for the shares alone."""
    steps: int | None = None
    """Where a run that does not reach the last error ends, steps; that of `python -m train` when not given."""
    every: int = 50_000
    """Steps between two judgements."""
    episodes: int = 64
    """Episodes of a judgement (count)."""
    rounds: int = 3
    """Pieces of training that the shares are medians of (count)."""
    piece: int = 49_152
    """Steps of such a piece."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""
    out: Path = Path("results/training")
    """Folder for training.json, which is added to."""


@dataclass
class Records:
    """The runs in training.json."""

    path: Path
    runs: list[dict[str, Any]] = field(default_factory=list)

    def find(self, key: dict[str, Any]) -> dict[str, Any] | None:
        """The finished run of these settings on this revision."""
        return next((run for run in self.runs if run["finished"] and run["key"] == key), None)

    def save(self) -> None:
        """Write the file."""
        write_atomically(self.path, (json.dumps({"runs": self.runs}, indent=2) + "\n").encode())


def measure(options: Options) -> Outcome:
    """A table of shares, a table of seeds."""
    if options.quick:
        options = replace(options, rounds=1, seeds=min(options.seeds, 1), steps=64, every=64, episodes=1, piece=64)
    if options.steps is not None:
        check_numbers(options, {"steps": (1, 10**12)})
    make_writable_folder(options.out)
    config = _config(options)
    records = _open(options.out)
    from benchmarks.probes.training_run import bare, shares  # torch takes seconds to import

    with stage("training, shares", options.rounds) as advance:
        pieces, physics = [], []
        for _ in range(options.rounds):
            pieces.append(shares(config, options.piece))
            physics.append(bare(config, options.piece) / options.piece)
            advance()
    tables, checks, reused = [_shares_table(pieces, physics, options)], tuple[Check, ...](), 0
    figures: dict[str, Any] = {"shares": pieces, "physics": physics}
    if options.seeds:
        times, reused = _seeds(options, config, records)
        tables.append(_times_table(times, options))
        medians = {threshold: float(np.median([run[threshold] for run in times])) for threshold in THRESHOLDS}
        figures |= {"seconds": times, "median": medians}
        if options.seeds >= SEEDS:
            checks = tuple(check(f"{options.policy} {goal:.2f}", medians[goal]) for goal in (0.15, 0.08))
    notes = (
        f"The clock: from before the robots are made, imports and judgements ({options.episodes} episodes) left out.",
        f"{reused} seeds were already in {records.path}" if reused else f"runs: {records.path}",
    )
    return Outcome(figures, tuple(tables), checks, notes if options.seeds else ())


def _config(options: Options) -> TrainConfig:
    config = replace(DEFAULTS[options.policy], threads=options.threads)
    if options.steps is not None:
        config = replace(config, steps=options.steps)
    if options.quick:
        tiny = PpoConfig(envs=8, rollout_steps=4, minibatch=16, epochs=1, actor=(4,), critic=(4,))
        config = replace(config, ppo=tiny, mixture=(("flat", 1.0),))
    return config


def _open(folder: Path) -> Records:
    path = folder / FILE
    if not path.exists():
        return Records(path)
    try:
        runs = json.loads(path.read_bytes())["runs"]
        if not all({"key", "finished", "trace"} <= set(run) for run in runs):
            raise ValueError("a run is not whole")
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{path} is no record of this benchmark: name another folder with --out") from None
    return Records(path, runs)


def _seeds(options: Options, config: TrainConfig, records: Records) -> tuple[list[dict[float, float]], int]:
    """Seconds to each error, one dict a seed; how many seeds were there already."""
    times, reused = [], 0
    revision = git_revision(REPOSITORY)
    for seed in range(options.seeds):
        one = replace(config, seed=seed)
        key = {"revision": revision, "every": options.every, "episodes": options.episodes, "threads": options.threads}
        key = plain(key | {"settings": to_dict(one)})
        # Uncommitted code may have changed since.
        found = records.find(key) if revision and not revision.endswith("-dirty") else None
        reused += found is not None
        found = found or _run(one, key, records, options)
        times.append(seconds_to(found["trace"]))
    return times, reused


def _run(config: TrainConfig, key: dict[str, Any], records: Records, options: Options) -> dict[str, Any]:
    """Train one seed; its record grows with every judgement."""
    from benchmarks.probes.training_run import train_and_judge

    record: dict[str, Any] = {"key": key, "machine": machine(), "finished": False, "trace": []}
    records.runs = [run for run in records.runs if run["key"] != key] + [record]

    def keeping(advance: Callable[[], None]) -> Callable[["Judgement"], None]:
        def report(judgement: "Judgement") -> None:
            record["trace"].append(dataclasses.asdict(judgement))
            records.save()
            advance()

        return report

    with stage(f"training, {config.policy}, seed {config.seed}", config.steps // options.every + 1) as advance:
        train_and_judge(config, options.every, options.episodes, min(THRESHOLDS), keeping(advance))
    record["finished"] = True
    records.save()
    return record


def seconds_to(trace: Sequence[dict[str, float]]) -> dict[float, float]:
    """Training seconds until each velocity error was first seen; infinite for one that never was."""
    return {
        goal: next((each["seconds"] for each in trace if each["velocity_error"] <= goal), float("inf"))
        for goal in THRESHOLDS
    }


def _shares_table(pieces: "Sequence[Shares]", physics: Sequence[float], options: Options) -> Table:
    """Where the time goes; the last row is how near it comes to nothing but `physics`, s a step of the learner."""
    rows = table(f"Wall time of training, {options.policy}", "", "µs a step")
    for name in ("environment", "rollout", "learner", "other", "total"):
        rows.add_row(name, f"{_of_a_step(pieces, name) * 1e6:.1f}")
    total, bare = _of_a_step(pieces, "total"), float(np.median(physics))
    rows.add_row("steps/s", f"{1.0 / total:,.0f}")
    rows.add_row("Batch.step alone", f"{bare * 1e6:.1f}")
    rows.add_row("steps/s per those of Batch.step alone", f"{bare / total:.2f}", style="bold")
    return rows


def _of_a_step(pieces: "Sequence[Shares]", name: str) -> float:
    """Median time of a part, s a step of the learner."""
    return float(np.median([getattr(piece, name) / piece.steps for piece in pieces]))


def _times_table(times: Sequence[dict[float, float]], options: Options) -> Table:
    heads = (f"{goal:.2f} m/s" for goal in THRESHOLDS)
    rows = table(f"Seconds to an error, {options.policy}", "seed", *heads)
    for seed, reached in enumerate(times):
        rows.add_row(str(seed), *(_shown(reached[goal]) for goal in THRESHOLDS))
    medians = (float(np.median([reached[goal] for reached in times])) for goal in THRESHOLDS)
    rows.add_row("median", *map(_shown, medians), style="bold")
    return rows


def _shown(seconds: float) -> str:
    return f"{seconds:.1f}" if seconds < float("inf") else "not reached"


main = command(Options, measure, "benchmarks.training", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
