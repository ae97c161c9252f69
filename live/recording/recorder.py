"""Recorder of episodes as MCAP files: observes control steps and sends each step to a writer process."""

import contextlib
import multiprocessing
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from live.recording.link_frames import RecordingSchema, link_frames
from live.recording.writer import write
from policies.base import Policy
from quad_env.cli.child_process import without_ctrl_c
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.extras import install_command
from quad_env.task.rewards import REWARD

PACKAGES = ("mcap", "rosbags")
"""Python packages that a recording requires; `pip install -e ".[recording]"` installs them."""
PIPE_SIZE = 1 << 20
"""Size of the pipe to the writer process, bytes; only Linux allows this size.

The pipe holds about ten seconds of control steps while the writer process starts or waits for a free processor core.
"""
SIGNALS = (
    *("position", "quaternion", "angular_velocity", "heading_velocity", "vertical_velocity"),
    *("joint_position", "joint_velocity", "joint_torque", "action", "command", "push"),
    *("foot_contact", "leg_contact", "trunk_contact", "fall", "diverged"),
)
"""Names of the readings in the environment's infos that are recorded at each control step."""


@contextmanager
def recorder_for(path: Path, policy: Policy) -> Iterator["McapRecorder"]:
    """Open a recorder of the first robot of a rollout, as a context manager.

    The file is kept even if the `with` block ends with an exception. If the recorder observes several episodes, the
    time of the recording continues from one episode to the next. A missing package or an invalid path raises
    UsageError. A full disk raises OSError, and the file keeps the messages that were written before.

    Args:
        path: MCAP file to write; the file must not exist.
        policy: Policy of the robot; its residual correction is recorded if it has one.

    Yields:
        The recorder, a function that is called with each control step.
    """
    check_recordable(path)
    recorder = McapRecorder(path, policy)
    try:
        yield recorder
    finally:
        recorder.close()


def check_recordable(path: Path) -> None:
    """Check that a recording can be written to a file.

    Args:
        path: MCAP file to write.

    Raises:
        UsageError: A package is missing, the file already exists, the suffix is not .mcap, or the folder cannot be
            created.
    """
    if missing := [package for package in PACKAGES if find_spec(package) is None]:
        raise UsageError(f"recording needs {missing[0]}: {install_command('recording')}")
    if path.exists():
        raise UsageError(f"{path} exists already: name another file")
    if path.suffix != ".mcap":
        raise UsageError(f"{path}: a recording is an MCAP file, such as walk.mcap")
    make_folder_of(path, "the recording")


class McapRecorder:
    """Observer that records the control steps of the first robot; `recorder_for` creates and closes it.

    Args:
        path: MCAP file to write.
        policy: Policy of the robot; its residual correction is recorded if it has one.
    """

    def __init__(self, path: Path, policy: Policy) -> None:
        self._path = path
        self._policy = policy
        self._process: BaseProcess | None = None
        self._rows: Connection | None = None

    def __call__(self, step: Step) -> None:
        """Record a control step or the start of an episode; raise OSError if the recording cannot be written."""
        is_first = self._rows is None
        if is_first:
            self._start_writer(step)
        correction = getattr(self._policy, "correction", None)
        readings = {name: step.infos[name][0] for name in SIGNALS}
        readings["reward"] = sum(step.infos[name][0] for name in step.infos if name.startswith(REWARD))
        readings["correction"] = np.full(step.action.shape[1], np.nan) if correction is None else correction[0]
        readings["start"] = step.number == 0 or is_first
        self._send(np.concatenate([np.ravel(reading) for reading in readings.values()], dtype=np.float64))

    def _start_writer(self, step: Step) -> None:
        """Start the writer process with the recording schema of the robot that `step` contains."""
        env = step.env
        robot = env.robot
        widths = {name: step.infos[name][0].size for name in SIGNALS}
        schema = RecordingSchema(
            widths=widths | {"reward": 1, "correction": robot.num_joints, "start": 1},
            joints=robot.joint_names,
            legs=robot.leg_names,
            links=link_frames(env.simulation.model, env.simulation.snapshot(0), robot),
            description="" if robot.urdf is None else robot.urdf.read_text(encoding="utf-8"),
            dt=env.dt,
        )
        context = multiprocessing.get_context("spawn")
        writer_end, self._rows = context.Pipe(duplex=False)
        self._answer, answer = context.Pipe(duplex=False)
        # Errors are ignored, because only Linux can set the size of a pipe, and the default size works too.
        with contextlib.suppress(ImportError, AttributeError, OSError):
            import fcntl

            fcntl.fcntl(self._rows.fileno(), fcntl.F_SETPIPE_SZ, PIPE_SIZE)
        self._process = context.Process(target=write, args=(writer_end, answer, self._path, schema))
        # The writer process must survive Ctrl-C, because `close` waits for the answer of the writer process.
        with closing(writer_end), closing(answer), without_ctrl_c():
            self._process.start()

    def _send(self, row: NDArray[np.float64]) -> None:
        """Send the numbers of a control step, (columns,), to the writer process; wait while the pipe is full."""
        assert self._rows is not None
        try:
            if not self._rows.closed:
                self._rows.send(row)
        except OSError:  # The writer process has ended; `close` raises the error of the writer process.
            self.close()

    def close(self) -> None:
        """Wait until the writer process has written the recording; raise OSError if it could not be written."""
        if self._process is None or self._rows is None or self._rows.closed:
            return
        self._rows.close()
        with closing(self._answer) as answer:
            try:
                failure = answer.recv()
            except (EOFError, OSError):
                failure = OSError("the process that writes the recording was ended")
        self._process.join()
        if failure is not None:
            raise failure
