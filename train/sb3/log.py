"""Outputs of SB3's logger for the metrics of each rollout: TensorBoard events, and JSON lines."""

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
    """TensorBoard output; TensorBoard hides events that an earlier session wrote after step `steps`."""

    def __init__(self, folder: Path, steps: int) -> None:
        self.writer = SummaryWriter(str(folder), purge_step=steps + 1)
        self._is_closed = False


class _MetricsFile(KVWriter):
    """Metrics file, with one line of JSON per rollout; lines after step `steps` are removed first.

    A metric that is NaN, for example a mean of no values, is written as null.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        cut_metrics(folder, steps)
        self._file = (folder / METRICS_FILE).open("a", encoding="utf-8")

    def write(self, key_values: dict[str, Any], key_excluded: Mapping[str, tuple[str, ...]], step: int = 0) -> None:
        """Append a line, unless there are no metrics.

        Args:
            key_values: Name -> value of the metrics.
            key_excluded: Not used. SB3 passes the output formats that leave out a metric.
            step: Number of steps of the run.
        """
        if values := {name: float(value) for name, value in sorted(key_values.items())}:
            self._file.write(json.dumps(nan_to_null({"steps": step} | values)) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def cut_metrics(folder: Path, steps: int) -> None:
    """Remove the lines after step `steps` from the metrics file in `folder`.

    A resumed run writes these lines again.

    Args:
        folder: Folder of the metrics file.
        steps: Last step that is kept.
    """
    path = folder / METRICS_FILE
    lines = read_bytes(path, MAX_DATA_SIZE).splitlines(keepends=True) if path.exists() else ()
    kept = itertools.takewhile(lambda line: line.endswith(b"\n") and json.loads(line)["steps"] <= steps, lines)
    write_atomically(path, b"".join(kept))


@contextlib.contextmanager
def run_logger(folder: Path, steps: int) -> Iterator[Logger]:
    """Open the logger of a run, within a context.

    TensorBoard writes in a thread. An OSError there, for example on a full disk, is not printed by the thread, because
    the next write raises it again.

    Args:
        folder: Folder of the run.
        steps: Number of steps at the start of the session.

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
