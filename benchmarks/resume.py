"""`python -m benchmarks.resume`: training runs killed with SIGKILL at random moments, resumed, compared to the bit.

One small run in one go comes first: its weights, optimiser, random states, validations and bundles are what the others
must end with. Moments are drawn from the life of the shortest run that came to its end, from the first file in its
folder on; a run that ends before its moment was not killed and does not count.
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.bars import check
from benchmarks.support.command import Outcome, Output, command, table
from benchmarks.support.progress import stage
from evaluate.records.provenance import REPOSITORY
from quad_env.cli.launcher import launch
from train.run_folder import CHECKPOINTS, CONFIG_FILE, METRICS_FILE, VALIDATIONS_FILE, has_checkpoint, steps_done

KILLS = 20
"""Of the row of what must be seen."""
TRAINING = (
    "--threads 1 --max-episode-steps 48 --mixture flat 0.5 push=100 0.25 rough 0.25 --ppo.envs 32 "
    "--ppo.rollout-steps 16 --ppo.hold 1 --ppo.minibatch 512 --ppo.epochs 2 "
    "--ppo.learning-rate-schedule adaptive --ppo.log-std-final -3 "
    "--validation.interval 4000 --validation.episodes 1 --validation.scenarios flat"
)
STEPS, FEW_STEPS = 12_000, 2_000
"""Segments of such a run take 1,536 steps."""


@dataclass(frozen=True)
class Options(Output):
    """How many of the killed runs end with the bits of the uninterrupted one."""

    kills: int = KILLS
    """Runs, each killed once (count)."""
    seed: int = 0
    """Of the moments."""


def measure(options: Options) -> Outcome:
    """A row a kill."""
    options = replace(options, kills=1) if options.quick else options
    steps = FEW_STEPS if options.quick else STEPS
    words = [*TRAINING.split(), "--steps", str(steps)]
    generator = np.random.default_rng(options.seed)
    kills: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder, stage("runs, killed and resumed", options.kills) as advance:
        lives = [_live(words, Path(folder) / "0")]
        expected = bits(Path(folder) / "0")
        while len(kills) < options.kills:
            run, moment = Path(folder) / f"{len(kills) + len(lives)}", float(generator.uniform(0.0, min(lives)))
            life = _live(words, run, moment)
            if life < moment:
                lives.append(life)
                continue
            record = {"seconds": moment, "checkpoint": steps_done(run) if has_checkpoint(run) else None}
            if steps_done(run) < steps:  # as its user would see and do
                _live(["--resume", "--threads", "1"] if has_checkpoint(run) else words, run)
            kills.append(record | {"same": bits(run) == expected})
            advance()
    rows = table("Runs killed with SIGKILL and resumed", "kill", "s", "last checkpoint, steps", "end")
    for number, kill in enumerate(kills):
        rows.add_row(
            str(number),
            f"{kill['seconds']:.2f}",
            "none" if kill["checkpoint"] is None else f"{kill['checkpoint']:,}",
            "same bits" if kill["same"] else "other bits",
        )
    same = sum(kill["same"] for kill in kills)
    checks = (check("resume", same),) if options.kills == KILLS else ()
    notes = (f"{same} of {len(kills)} resumed to the bit; a run in one go lived {min(lives):.1f} s.",)
    return Outcome({"kills": kills, "same": same, "lives": lives}, (rows,), checks, notes)


def bits(folder: Path) -> dict[str, bytes]:
    """All of a run's folder that must not hang on interruptions, by file: no clock, no log."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.safetensors")}
    found[VALIDATIONS_FILE] = (folder / VALIDATIONS_FILE).read_bytes()
    for path in (folder / CHECKPOINTS).glob("*.json"):
        record = json.loads(path.read_bytes())
        del record["remembered"]["seconds"]
        found[path.name] = json.dumps(record).encode()
    metrics = [json.loads(line) for line in (folder / METRICS_FILE).read_bytes().splitlines()]
    for figures in metrics:
        del figures["time/seconds"]
    found[METRICS_FILE] = json.dumps(metrics).encode()
    return found


def _live(words: list[str], folder: Path, most: float | None = None) -> float:
    """Train, to the end or to a kill after so many seconds; seconds from the first file on. OSError where it fails."""
    line = [sys.executable, "-m", "train", *words, "--out", str(folder)]
    with subprocess.Popen(line, cwd=REPOSITORY, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            while process.poll() is None and not (folder / CONFIG_FILE).exists():
                time.sleep(0.002)
            begin = time.perf_counter()
            _, complaint = process.communicate(timeout=most)
            life = time.perf_counter() - begin
        except subprocess.TimeoutExpired:
            return float(most or 0.0)
        finally:
            process.kill()
    if process.returncode:
        raise OSError(f"python -m train failed: {(complaint.decode().splitlines() or ['no message'])[-1]}")
    return life


main = command(Options, measure, "benchmarks.resume", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
