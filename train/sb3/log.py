"""Outputs of the Stable-Baselines3 (SB3) logger for the metrics of each rollout: TensorBoard and JSON lines."""

import contextlib
import itertools
import json
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from torch.utils.tensorboard import SummaryWriter

from evaluate.analysis.results import nan_to_null
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from quad_env.files.writing import write_atomically
from train.run_folder import METRICS_FILE, TENSORBOARD


class _TensorBoardEvents(TensorBoardOutputFormat):
    """TensorBoard output of a training run that starts or resumes at step `steps`.

    TensorBoard hides events of later steps that the run wrote before it was stopped and resumed.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        self.writer = SummaryWriter(str(folder), purge_step=steps + 1)
        self._is_closed = False


class _MetricsFile(KVWriter):
    """File output of the training metrics, with one line of JSON per rollout.

    The constructor removes lines of later steps than `steps`, at which the run starts or resumes. A metric that is NaN,
    for example a mean of no values, is written as null.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        cut_metrics(folder, steps)
        self._file = (folder / METRICS_FILE).open("a", encoding="utf-8")

    def write(self, key_values: dict[str, Any], key_excluded: Mapping[str, tuple[str, ...]], step: int = 0) -> None:
        """Append a line with the metrics of a rollout to the file, if there are metrics.

        Args:
            key_values: Name of the metric -> value.
            key_excluded: Not used. SB3 passes here the names of the output formats that leave out a metric.
            step: Number of learner steps of the run at the end of the rollout.
        """
        if values := {name: float(value) for name, value in sorted(key_values.items())}:
            self._file.write(json.dumps(nan_to_null({"steps": step} | values)) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the metrics file."""
        self._file.close()


def cut_metrics(folder: Path, steps: int) -> None:
    """Remove the lines of later steps than `steps` from the metrics file of a run.

    A run that resumes at this step writes these lines again.

    Args:
        folder: Folder of the run, with the metrics file.
        steps: Last learner step with a line that is kept.
    """
    path = folder / METRICS_FILE
    lines = read_bytes(path, MAX_DATA_SIZE).splitlines(keepends=True) if path.exists() else ()
    kept = itertools.takewhile(lambda line: line.endswith(b"\n") and json.loads(line)["steps"] <= steps, lines)
    write_atomically(path, b"".join(kept))


@contextlib.contextmanager
def run_logger(folder: Path, steps: int) -> Iterator[Logger]:
    """Open the SB3 logger of a training run, and close it at the end of the context.

    TensorBoard writes in a thread. An OSError in the thread, for example because the disk is full, is not printed
    there. The next write of the logger raises the same error.

    Args:
        folder: Folder of the run.
        steps: Number of learner steps at which the run starts or resumes.

    Yields:
        The logger.
    """

    def report(failure: threading.ExceptHookArgs) -> None:
        if not issubclass(failure.exc_type, OSError):
            hook(failure)

    hook = threading.excepthook
    threading.excepthook = report
    try:
        logger = Logger(str(folder), [_TensorBoardEvents(folder / TENSORBOARD, steps), _MetricsFile(folder, steps)])
        with contextlib.closing(logger):
            yield logger
    finally:
        threading.excepthook = hook
