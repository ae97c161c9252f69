"""Tasks on a Ray cluster: each task runs in a worker process, and runs again if its worker dies.

No other module imports Ray, and this one imports it only when a cluster is used. The results of the tasks do not depend
on the workers. Every worker checks that it has the versions of this process before it runs a task, and adds the
extensions of this process.
"""

import contextlib
import ipaddress
import os
import platform
import queue
import secrets
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from evaluate.rollouts.task_files import Unpacked, pack, unpack
from evaluate.rollouts.workers import BLAS_THREADS, WorkerDiedError, picklable
from quad_env.cli.command_line import UsageError
from quad_env.extensions import Extension, add_extension, added_extensions
from quad_env.files.text import one_line

POLL_PERIOD = 0.2
"""Period of the checks for Ctrl-C, s."""
REPORT_PERIOD = 0.5
"""Minimum time between two progress messages of a task, s."""
CONNECT_TIMEOUT = 10.0
"""Maximum time in which the address of a cluster must answer, s."""
MAX_ATTEMPTS = 10
"""Number of times that a task is started if its worker dies every time."""
TASKS_PER_CORE = 2
"""Number of submitted tasks per core of the cluster, so that no worker waits for its next task."""
OBJECT_STORE = 2**28
"""Memory in which a cluster that is started here passes tasks and results, bytes."""
FOLDER_PREFIX = "quad-ray-"
"""First part of the name of the temporary folder of a cluster that is started here."""
LOOPBACK = "127.0.0.1"
"""Address of a cluster that is started here; no other machine can reach it."""
_TOKEN = "RAY_AUTH_TOKEN"
_LOCAL_ADDRESSES = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""Environment variable of Ray; with the value 0 a node has the address of the loopback interface."""

Report = Callable[[Any], None]
"""Function with which a task sends a message about its progress to the process that waits for it."""
Work = Callable[[Unpacked, Report], Any]
"""Function that a worker runs: it takes the value of a task and a report function, and returns the result."""


class ClusterError(UsageError):
    """Error that is raised if a cluster cannot be used, or a worker has other versions."""


@dataclass(frozen=True)
class VersionCheck:
    """Check that a worker has the software of the process that sends the tasks."""

    expected: Mapping[str, str]
    """Name of a package, of the code or of the processor -> version in the sending process."""
    found: Callable[[], Mapping[str, str]]
    """Function that returns the same mapping for the process that calls it."""

    def __call__(self) -> None:
        """Raise ClusterError, with the name of this machine, if a version differs."""
        found = self.found()
        different = [name for name, version in self.expected.items() if found.get(name) != version]
        if different:
            facts = ", ".join(f"{name} {self.expected[name]}, got {found.get(name)}" for name in different)
            raise ClusterError(f"--ray: worker on {platform.node()}: needs {facts}; valid: the same on every node")


@dataclass
class _RunningTask:
    """Task that has been sent to the cluster."""

    index: int
    """Index of the task in the list of tasks."""
    attempts: int = 0
    """Number of workers that have died in the task."""


@dataclass(frozen=True)
class _Message:
    """Message of a worker about its task."""

    is_result: bool
    """True for the result or the exception of the task, which is its last message."""
    content: Any
    """Result, exception or message about the progress."""


@dataclass
class RayCluster:
    """Connection to a Ray cluster, made by `connect`."""

    ray: Any
    """Module `ray`."""
    check_worker: Callable[[], None]
    """Function that each worker calls before its first task; it raises an exception if the worker must not run."""
    _contents: dict[str, Any] = field(default_factory=dict)
    """Absolute path of a file that tasks need -> reference to its content in the cluster."""

    @property
    def cores(self) -> int:
        """Number of processor cores of all nodes, at least 1."""
        return max(1, int(self.ray.cluster_resources().get("CPU", 1)))

    def run(
        self,
        work: Work,
        values: Sequence[Callable[[], Any]],
        receive: Callable[[int, Any], None],
        check: Callable[[], None] = lambda: None,
        resources: Mapping[str, float] | None = None,
    ) -> Generator[tuple[int, Any]]:
        """Run a task for each value, and yield the index and the result of each finished task.

        Args:
            work: Function at the top of a module, which runs a task.
            values: For each task a function that makes its value. It is called again if the worker of the task dies.
            receive: Function that receives the index of a task and each message that the task reports.
            check: Function that is called repeatedly. If it raises an exception, all tasks are cancelled.
            resources: Options of a Ray task, such as `num_cpus`; by default one core.

        Yields:
            Index of the task, and its result.

        WorkerDiedError is raised if the worker of a task has died MAX_ATTEMPTS times, and ClusterError if a worker has
        other versions or cannot run the task.
        """
        options = {"num_cpus": 1, **(resources or {})}
        remote = self.ray.remote(max_retries=0, num_returns="streaming", **options)(_run_task)
        waiting = [_RunningTask(index) for index in reversed(range(len(values)))]
        running: dict[Any, _RunningTask] = {}
        try:
            while waiting or running:
                check()
                limit = TASKS_PER_CORE * self.cores // options["num_cpus"] if waiting else 0
                while waiting and len(running) < max(1, limit):
                    task = waiting.pop()
                    running[self._submit(remote, work, values[task.index]())] = task
                ready, _ = self.ray.wait(list(running), num_returns=1, timeout=POLL_PERIOD)
                for stream in ready:
                    task = running[stream]
                    answer = self._next_message(stream, task)
                    if answer is None:
                        del running[stream]
                        waiting.append(task)
                    elif answer.is_result:
                        del running[stream]
                        yield task.index, answer.content
                    else:
                        receive(task.index, answer.content)
        finally:
            for stream in running:
                with contextlib.suppress(Exception):
                    self.ray.cancel(stream, force=True)

    def _next_message(self, stream: Any, task: _RunningTask) -> _Message | None:
        """Return the next message of a task, or None if its worker has died; raise the exception of a task."""
        try:
            message: _Message = self.ray.get(next(stream))
        except (self.ray.exceptions.RayError, StopIteration) as error:
            task.attempts += 1
            self._check_death(error, task)
            return None
        if isinstance(message.content, BaseException):
            raise message.content
        return message

    def _submit(self, remote: Any, work: Work, value: Any) -> Any:
        """Send a task and the extensions of this process to the cluster, and return the stream of its messages."""
        packed = pack((value, work, added_extensions()))
        for file in packed.files:
            if file not in self._contents:
                self._contents[file] = self.ray.put(Path(file).read_bytes())
        files = {file: self._contents[file] for file in packed.files}
        return remote.remote(self.check_worker, packed.body, files)

    def _check_death(self, error: Exception, task: _RunningTask) -> None:
        """Print that the worker of a task has died; raise an exception if the task must not start again."""
        reason = one_line(str(error)).partition(". ")[0] or type(error).__name__
        if isinstance(error, self.ray.exceptions.RayTaskError):
            cause = one_line(str(error.cause))
            raise ClusterError(f"--ray: a worker cannot run tasks ({cause}); valid: this project on every node")
        if isinstance(error, self.ray.exceptions.TaskUnschedulableError | self.ray.exceptions.RuntimeEnvSetupError):
            raise ClusterError(f"--ray: the cluster cannot start a worker ({reason})") from error
        if task.attempts >= MAX_ATTEMPTS:
            times = f"{task.attempts} times in the same task"
            raise WorkerDiedError(f"a Ray worker has died {times} ({reason}), for want of memory perhaps") from error
        print(f"a Ray worker has died ({reason}); its task starts again", file=sys.stderr, flush=True)


def _run_task(check_worker: Callable[[], None], body: bytes, files: Mapping[str, Any]) -> Iterator[_Message]:
    """Run a task in a worker, and yield its messages, then its result or its exception.

    Args:
        check_worker: Function that raises an exception if this process must not run the task.
        body: Pickle of the value, of the function that runs the task, and of the extensions of the sending process.
        files: Path of a file that the task needs -> reference to its content.

    Yields:
        The messages.
    """
    import ray

    messages = queue.SimpleQueue[_Message]()
    contents = dict(zip(files, ray.get(list(files.values())), strict=True))

    def run() -> None:
        try:
            _check_once(check_worker)
            with tempfile.TemporaryDirectory(prefix="quad-env-", ignore_cleanup_errors=True) as folder:
                unpacked = unpack(body, contents, Path(folder))
                value, work, extensions = unpacked.value
                _add_once(extensions)
                messages.put(_Message(True, work(replace(unpacked, value=value), _limited_report(messages))))
        except BaseException as error:
            messages.put(_Message(True, picklable(error)))

    threading.Thread(target=run, daemon=True).start()
    while not (message := messages.get()).is_result:
        yield message
    yield message


_is_checked = threading.Event()


def _check_once(check_worker: Callable[[], None]) -> None:
    """Call a check in the first task of this process."""
    if not _is_checked.is_set():
        check_worker()
        _is_checked.set()


def _add_once(extensions: Sequence[Extension]) -> None:
    """Add extensions to this process, unless it has some from an earlier task."""
    if not added_extensions():
        for extension in extensions:
            add_extension(extension)


def _limited_report(messages: "queue.SimpleQueue[_Message]") -> Report:
    """Return a function that sends messages, but no number within REPORT_PERIOD after the message before it."""
    next_time = 0.0

    def report(message: Any) -> None:
        nonlocal next_time
        now = time.monotonic()
        if isinstance(message, float) and now < next_time:
            return
        next_time = now + REPORT_PERIOD
        messages.put(_Message(False, message))

    return report


@contextlib.contextmanager
def connect(address: str | None, cores: int, check_worker: Callable[[], None]) -> Iterator[RayCluster]:
    """Use the Ray cluster at an address, or start one on this machine and end it with the context.

    Args:
        address: Address `HOST:PORT` of a running cluster; None to start one.
        cores: Number of workers of a cluster that is started.
        check_worker: Function that each worker calls before its first task.

    Yields:
        The connection.

    ClusterError is raised if there is no usable cluster at the address, or no cluster can be started.
    """
    if address is not None:
        _check_address(address)
    os.environ["RAY_AUTH_MODE"] = "token"
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Nothing is sent to anybody.
    os.environ["RAY_ENABLE_UV_RUN_RUNTIME_ENV"] = "0"
    if address is None or _is_loopback(address.rpartition(":")[0]):
        os.environ[_LOCAL_ADDRESSES] = "0"
    folder = None
    try:
        if address is None:
            os.environ.setdefault(_TOKEN, secrets.token_hex(32))
            # The path is short, because the operating system limits the length of the paths of sockets in the folder.
            folder = tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir="/tmp" if os.path.isdir("/tmp") else None)
        ray = _initialise(address, cores, folder)
        try:
            yield RayCluster(ray, check_worker)
        finally:
            ray.shutdown()
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def _initialise(address: str | None, cores: int, folder: str | None) -> Any:
    """Connect this process to a cluster, and return the module `ray`; see `connect`.

    Args:
        address: Address of the cluster, None to start one.
        cores: Number of workers of a cluster that is started.
        folder: Folder for the files of a cluster that is started.

    Returns:
        The module `ray`.

    Raises:
        ClusterError: No cluster is usable at the address, or none can be started.
    """
    import ray

    variables = {name: value for name, value in os.environ.items() if name.startswith("QUAD_ENV_")}
    settings: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": "CRITICAL",
        "runtime_env": {"env_vars": {**variables, BLAS_THREADS: "1"}},
    }
    if address is None:
        settings |= {"num_cpus": cores, "object_store_memory": OBJECT_STORE, "include_dashboard": False}
        settings |= {"_node_ip_address": LOOPBACK, "_temp_dir": folder}
    try:
        ray.init(address=address or "local", **settings)
    except (ray.exceptions.RayError, ConnectionError, RuntimeError, ValueError, OSError, AssertionError) as error:
        subject = f"no cluster is usable at {address}" if address else "no cluster can be started on this machine"
        raise ClusterError(f"--ray: {subject} ({one_line(str(error))[:300]})") from error
    return ray


def _check_address(address: str) -> None:
    """Raise ClusterError if an address has not the form HOST:PORT, or no process answers at it."""
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isdecimal()) or "/" in host:
        raise ClusterError(f"--ray: no address of a cluster, got {address}; valid: HOST:PORT, as in 10.0.0.1:6379")
    try:
        socket.create_connection((host, int(port)), CONNECT_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ClusterError(f"--ray: no cluster answers at {address} ({reason})") from error


def _is_loopback(host: str) -> bool:
    """Return True if a host is this machine's loopback interface."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
