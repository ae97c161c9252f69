"""Recorder: an observer of control steps that leaves them in shared memory for a process that writes them."""

import contextlib
import multiprocessing
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from evaluate.rollouts.observers import Step
from live.recording.rows import Floats, Ring, Source, memory
from live.recording.skeleton import links_of
from live.recording.writer import write
from policies.base import Policy
from quad_env.cli.child_process import without_ctrl_c
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.task.rewards import REWARD

PACKAGES = ("mcap", "rosbags")
"""What the extra `recording` installs."""
STEPS_A_BATCH = 100
"""Control steps that are written together."""
SIGNALS = (
    *("position", "quaternion", "angular_velocity", "heading_velocity", "vertical_velocity"),
    *("joint_position", "joint_velocity", "joint_torque", "action", "command", "push"),
    *("foot_contact", "leg_contact", "trunk_contact", "fall", "diverged"),
)
"""Readings of a control step that are recorded, by their names in the infos."""
WAIT = 0.002
"""Between two looks whether there is room for a row, s."""


@contextmanager
def recorder_for(path: Path, policy: Policy) -> Iterator["Recorder"]:
    """An observer that records the first robot: into an MCAP file by a path that ends in .mcap, else into the folder of
    a ROS 2 bag. What was recorded is kept however the block ends; a further episode goes on where the first ended.

    Raises:
        UsageError: a package is missing, or the path exists already or cannot be written.
        OSError: the disk is full; what was written by then is left.
    """
    check(path)
    recorder = Recorder(path, policy)
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


class Recorder:
    """Records the first robot of the steps that it is called with; `recorder_for` makes one and closes it."""

    def __init__(self, path: Path, policy: Policy) -> None:
        self.policy = policy
        """Whose correction is recorded, where it has one; may be another one from any step on."""
        self._path = path
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._announced = 0
        self._events: list[str] = []

    def __call__(self, step: Step) -> None:
        """Record a control step, or the start of an episode. Raises OSError where it cannot be written."""
        if self._pipe is None:
            self._begin(step)
        if (row := self._free_row()) is None:
            return
        correction = getattr(self.policy, "correction", None)
        own = {
            "correction": np.nan if correction is None else correction[0],
            "start": step.number == 0 or self._ring.put == 0,
        }
        for name, columns in self._slices.items():
            row[columns] = own[name] if name in own else step.infos[name][0]
        self._ring.put_row()
        for event in self._events:
            self._announce(event)
        self._events.clear()
        if self._ring.put - self._announced >= STEPS_A_BATCH:
            self._announce()

    def event(self, text: str) -> None:
        """Record that something happened just now, after the last step. Raises OSError where it cannot be written."""
        if self._pipe is None:
            self._events.append(text)
        else:
            self._announce(text)

    def _begin(self, step: Step) -> None:
        env, robot = step.env, step.env.robot
        names = (*SIGNALS, *(name for name in step.infos if name.startswith(REWARD)))
        source = Source(
            widths={name: step.infos[name][0].size for name in names} | {"correction": robot.num_joints, "start": 1},
            joints=robot.joint_names,
            legs=robot.leg_names,
            links=links_of(env.simulation.model, env.simulation.snapshot(0), robot),
            description="" if robot.urdf is None else robot.urdf.read_text(encoding="utf-8"),
            dt=env.dt,
        )
        self._slices = source.slices
        context = multiprocessing.get_context("spawn")
        shared = memory(context, sum(source.widths.values()))
        self._ring = Ring(shared)
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=write, args=(theirs, shared, self._path, source))
        with closing(theirs), without_ctrl_c():  # also where Ctrl-C comes meanwhile, else `close` waits for ever
            self._process.start()

    def _free_row(self) -> Floats | None:
        """Where the next row goes, once there is room; None where the writer has ended."""
        assert self._process is not None
        while (row := self._ring.free_row()) is None:
            if not self._process.is_alive():
                self.close()
                return None
            time.sleep(WAIT)
        return row

    def _announce(self, event: str = "") -> None:
        """Send how many rows there are, and what happened then."""
        assert self._pipe is not None
        self._announced = self._ring.put
        try:
            self._pipe.send((self._announced, event))
        except OSError:  # the writer has ended, and sent its reason
            self.close()

    def close(self) -> None:
        """Wait until all of it is written. Raises OSError where it could not be."""
        if self._process is None or self._pipe is None or self._pipe.closed:
            return
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
