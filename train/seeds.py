"""Runs of several seeds: one after the other here, or side by side as tasks of a Ray cluster."""

import contextlib
import io
import os
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from evaluate.records.provenance import REPOSITORY, REVISION, git_revision
from evaluate.rollouts.cluster import Report, cluster
from quad_env.cli.command_line import UsageError
from quad_env.cli.cores import available_cores
from quad_env.files.writing import sole_use, write_atomically
from train.config import TrainConfig
from train.run import train
from train.run_folder import CHECKPOINTS, begun, has_checkpoint, refuse_folder_in_use, steps_done, writing

Files = dict[str, bytes]
"""What a run's folder holds: path in it -> contents."""


def train_seeds(config: TrainConfig) -> None:
    """Train every seed of the settings. Raises as `train` does."""
    runs: Sequence[TrainConfig] = config.runs
    if config.seeds > 1:
        runs = [replace(run, resume=config.resume and has_checkpoint(run.folder)) for run in runs]
        runs = [run for run in runs if not run.resume or steps_done(run.folder) < run.steps]
        if not runs:
            raise UsageError(f"all runs in {config.folder} are finished: extend them with a larger --steps")
    for run in runs:
        if not run.resume:
            refuse_folder_in_use(run.folder)
    if config.engine == "ray":
        _train_on_cluster(runs, config)
        return
    for run in runs:
        if config.seeds > 1:
            print(f"seed {run.seed}", flush=True)
        train(run)


def _train_on_cluster(runs: Sequence[TrainConfig], config: TrainConfig) -> None:
    """A task for each run; its folder here has what the task last told."""

    def told(place: int, news: str | Files) -> None:
        if isinstance(news, str):
            print(f"seed {runs[place].seed}: {news}", flush=True)
        else:
            _write(runs[place].folder, news)

    revision = git_revision(REPOSITORY) or ""
    with contextlib.ExitStack() as stack:
        for run in runs:
            stack.enter_context(sole_use(run.folder) if run.resume else begun(run.folder))
        tasks = [(run, _read(run.folder), revision) for run in runs]
        spread = stack.enter_context(cluster(max(config.threads, available_cores()), config.address))
        for place, files in spread(_train_apart, tasks, told, config.threads):
            with writing(runs[place].folder):
                _write(runs[place].folder, files)


def _train_apart(task: tuple[TrainConfig, Files, str], report: Report) -> Files:
    """A run in a folder of its own that goes with the task; what it held."""
    run, files, revision = task
    os.environ[REVISION] = revision
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        _write(folder, files)
        with contextlib.redirect_stdout(_Lines(report, folder)):
            train(replace(run, out=folder))
        return _read(folder)


class _Lines(io.TextIOBase):
    """Standard output that is reported by lines, each time with the folder of a run that has a new checkpoint."""

    def __init__(self, report: Report, folder: Path) -> None:
        self._report, self._folder, self._sent = report, folder, steps_done(folder)

    def write(self, text: str) -> int:
        """Report."""
        if line := text.strip():
            self._report(line)
        if (done := steps_done(self._folder)) > self._sent:
            self._report(_read(self._folder))
            self._sent = done
        return len(text)


def _read(folder: Path) -> Files:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _write(folder: Path, files: Files) -> None:
    """Make the folder of a run hold these files; checkpoints that it has not among them are forgotten."""
    for name in sorted(files, key=lambda name: name.endswith(".json")):  # a checkpoint is there once its JSON is
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / name, files[name])
    for path in (folder / CHECKPOINTS).glob("*"):
        if f"{CHECKPOINTS}/{path.name}" not in files:
            path.unlink()
