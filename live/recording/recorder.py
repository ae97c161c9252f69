"""Recorder: an observer of control steps that hands them, second by second, to a process that writes them."""

import contextlib
import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.rollouts.observers import Observer, Step
from evaluate.terminal.command_line import UsageError, make_folder_of
from live.recording.source import Source
from live.recording.writer import write
from policies.base import Policy
from quad_env.task.rewards import REWARD

PACKAGES = ("mcap", "rosbags")
"""What the extra `recording` installs."""
STEPS_A_BATCH = 100
"""Control steps that are handed over together: at most so many are lost when this process is killed."""
SIGNALS = (
    *("position", "quaternion", "angular_velocity", "heading_velocity", "vertical_velocity"),
    *("joint_position", "joint_velocity", "joint_torque", "action", "command", "push"),
    *("foot_position", "foot_contact", "leg_contact", "trunk_contact", "fall", "diverged"),
)
"""Readings of a control step that are recorded, by their names in the infos."""


@contextmanager
def recorder_for(path: Path, policy: Policy) -> Iterator[Observer]:
    """An observer that records the first robot: into an MCAP file by a path that ends in .mcap, else into the folder of
    a ROS 2 bag. What was recorded is kept however the block ends; a second episode goes on where the first ended.

    Raises:
        UsageError: a package is missing, or the path exists already or cannot be written.
        OSError: the disk is full; what was written by then is left.
    """
    check(path)
    recorder = _Recorder(path, policy)
    try:
        yield recorder
    finally:
        recorder.close()


def check(path: Path) -> None:
    """Raise UsageError where nothing can be recorded into that path."""
    if missing := [package for package in PACKAGES if find_spec(package) is None]:
        raise UsageError(f'recording needs {missing[0]}: pip install -e ".[recording]"')
    if path.exists():
        raise UsageError(f"{path} exists already: name another file, or a folder that is yet to be")
    make_folder_of(path, "the recording")


class _Recorder:
    def __init__(self, path: Path, policy: Policy) -> None:
        self._path, self._policy = path, policy
        self._steps: list[list[Any]] = []
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._done = 0

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        if self._pipe is None:
            self._begin(step)
        if step.number == 0 and self._done:
            return  # a further episode: its start is no control step
        correction = getattr(self._policy, "correction", None)
        row = [self._done, *(step.infos[name][0] for name in self._names)]
        row.append(np.zeros(0) if correction is None else correction[0].copy())
        self._steps.append(row)
        self._done += 1
        if len(self._steps) == STEPS_A_BATCH:
            self._hand_over()

    def _begin(self, step: Step) -> None:
        env, robot = step.env, step.env.robot
        self._names = (*SIGNALS, *(name for name in step.infos if name.startswith(REWARD)))
        source = Source(self._names, robot.joint_names, robot.leg_names, env.dt)
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=write, args=(theirs, self._path, source))
        self._process.start()
        theirs.close()

    def _hand_over(self) -> None:
        assert self._pipe is not None
        batch = [np.stack(column) for column in zip(*self._steps, strict=True)]
        self._steps.clear()
        try:
            self._pipe.send(batch)
        except OSError:  # the writer has ended, and told why
            self.close()

    def close(self) -> None:
        """Hand over what is left, and wait until all of it is written. Raises OSError where it could not be."""
        if self._pipe is None or self._process is None or self._pipe.closed:
            return
        if self._steps:
            self._hand_over()
        with contextlib.suppress(OSError):
            self._pipe.send(None)
        try:
            failure = self._pipe.recv()
        except (EOFError, OSError):
            failure = OSError("the process that writes the recording was ended")
        self._pipe.close()
        self._process.join()
        if failure is not None:
            raise failure
