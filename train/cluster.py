"""Training runs of several seeds as tasks of a Ray cluster.

A run trains in a temporary folder of its worker. Each time it has a new checkpoint, its files are copied to the run
folder of the process that has sent the task, from which the run continues if its worker dies.
"""

import contextlib
import dataclasses
import io
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from evaluate.records.software import software_versions
from evaluate.rollouts.cluster import RayCluster, Report, VersionCheck, connect
from evaluate.rollouts.task_files import Unpacked, mark_files
from quad_env.cli.child_process import available_cores
from quad_env.files.reading import has_content
from quad_env.files.writing import exclusive_lock, make_writable_folder, write_atomically
from train.config import TrainConfig
from train.distillation.config import DistillationConfig
from train.distillation.run import distil
from train.run import train
from train.run_folder import CHECKPOINTS, report_write_errors, steps_done
from train.run_record import LEARNER_PACKAGES

Settings = TrainConfig | DistillationConfig
Files = Mapping[str, bytes]
"""Files of a run folder: relative path -> content."""
Work = tuple[Settings, str, Files]
"""Settings of a run, its folder in the sending process, and its files so far."""
_TEXT_SUFFIXES = (".json", ".jsonl", ".md")
"""Endings of the names of text files in which the folder of the worker is replaced by the run folder."""


def train_on_cluster(runs: Sequence[Settings], address: str | None) -> None:
    """Train runs on a Ray cluster, and write the files of each run to its folder.

    UsageError is raised if the cluster cannot be used, a run fails, or a file cannot be written.

    Args:
        runs: Settings of each run.
        address: Address of the cluster; None to start one on this machine.
    """
    if not runs:
        return
    with contextlib.ExitStack() as stack:
        for run in runs:
            with report_write_errors(run.folder):
                make_writable_folder(run.folder)
            stack.enter_context(exclusive_lock(run.folder))
        check_versions = VersionCheck(_versions(), _versions)
        cores = max(available_cores(), runs[0].threads)
        cluster = stack.enter_context(connect(address, cores, check_versions))
        _warn_if_too_small(cluster, runs[0].threads)

        def receive(index: int, message: str | Files) -> None:
            if isinstance(message, str):
                print(f"seed {runs[index].seed}: {message}", flush=True)
            else:
                _write(runs[index].folder, message)

        values = [partial(_work, run) for run in runs]
        resources = {"num_cpus": runs[0].threads, "num_gpus": int(getattr(runs[0], "device", "cpu") == "cuda")}
        for index, files in cluster.run(_train_run, values, receive, resources=resources):
            _write(runs[index].folder, files)
            print(f"seed {runs[index].seed} is finished: {runs[index].folder}", flush=True)


def _versions() -> dict[str, str]:
    """Return the versions of the software on which a training run depends."""
    return software_versions(LEARNER_PACKAGES, ("train",))


def _warn_if_too_small(cluster: RayCluster, threads: int) -> None:
    """Print a warning if no node of the cluster has a core for each thread of a run."""
    largest = max((int(node["Resources"].get("CPU", 0)) for node in cluster.ray.nodes() if node["Alive"]), default=0)
    if largest < threads:
        print(f"--ray: waiting for a node with {threads} cores, the largest has {largest}", file=sys.stderr, flush=True)


def _work(run: Settings) -> Work:
    """Return the value of the task that trains a run, with the files that its folder has now."""
    sent = mark_files(dataclasses.replace(run, out=None, seeds=None, part=None, ray=None))
    return sent, str(run.folder), _read(run.folder)


def _train_run(unpacked: Unpacked, report: Report) -> Files:
    """Train a run in a worker, and report its printed lines, and its files after each checkpoint.

    The run continues from the last checkpoint among its files, if there is one.

    Args:
        unpacked: Value of the task, as `_work` makes it.
        report: Function that sends a line or the files to the process that has sent the task.

    Returns:
        The files of the run folder.
    """
    settings, original, files = unpacked.value
    with tempfile.TemporaryDirectory(prefix="quad-env-", ignore_cleanup_errors=True) as place:
        folder = Path(place) / Path(original).name
        names = Unpacked(None, True, {**unpacked.originals, str(folder): original})
        if has_files := any(name.startswith(CHECKPOINTS) for name in files):
            _write(folder, files)
        with contextlib.redirect_stdout(_Lines(report, folder, names)):
            _train(dataclasses.replace(settings, out=folder, resume=has_files))
        return _restored(folder, names)


def _train(settings: Settings) -> None:
    """Train a run by PPO, or distil a policy, as its settings select."""
    if isinstance(settings, TrainConfig):
        train(settings)
    else:
        distil(settings)


class _Lines(io.TextIOBase):
    """Standard output that reports each line, and the files of a run that has a new checkpoint."""

    def __init__(self, report: Report, folder: Path, names: Unpacked) -> None:
        self._report = report
        self._folder = folder
        self._names = names
        self._sent_steps = steps_done(folder)

    def write(self, text: str) -> int:
        """Report a text, and return its length."""
        for line in filter(None, map(str.strip, text.splitlines())):
            self._report(self._names.restore(line))
        done = steps_done(self._folder)
        if done > self._sent_steps:
            self._sent_steps = done
            self._report(_restored(self._folder, self._names))
        return len(text)


def _restored(folder: Path, names: Unpacked) -> Files:
    """Return the files of a run folder, with the paths of the process that has sent the task."""
    files = _read(folder)
    for name, content in files.items():
        if name.endswith(_TEXT_SUFFIXES):
            files[name] = names.restore(content.decode("utf-8")).encode("utf-8")
    return files


def _read(folder: Path) -> dict[str, bytes]:
    """Return the files of a run folder, without temporary files."""
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith("."))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _write(folder: Path, files: Any) -> None:
    """Write the files of a run to its folder, and delete the checkpoints that are not among them."""
    with report_write_errors(folder):
        # The JSON file of a checkpoint is written last, because it marks the checkpoint as complete.
        for name in sorted(files, key=lambda name: name.endswith(".json")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if not has_content(folder / name, files[name]):
                write_atomically(folder / name, files[name])
        for path in (folder / CHECKPOINTS).glob("*"):
            if f"{CHECKPOINTS}/{path.name}" not in files:
                path.unlink()
