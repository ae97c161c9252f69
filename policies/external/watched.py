"""A policy in a process of its own, watched from outside: whatever it does, an answer or an error comes in time."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any

from quad_env.cli.child_process import Watchdog, exit_with_parent, without_ctrl_c, without_main
from quad_env.files.text import format_exception

START_TIMEOUT = 60.0
"""s. Longest run time in which the process makes its policy; waits for a processor do not count."""
IMPORT_TIMEOUT = 300.0
"""s. Longest run time in which the process starts and imports the project."""

_asking: Connection | None = None
"""In a policy's process: the connection to the process that asks it."""


class DeadlineMissedError(RuntimeError):
    """The policy gave no answer in time; its process has been ended."""


class PolicyProcessError(RuntimeError):
    """The policy raised an exception in its process, or the process is gone; the message says which."""


class PolicyProcess:
    """Object in a subprocess, with a timeout on every call.

    Args:
        make: makes the object, in the other process; picklable, such as `functools.partial(policies.make, "trot")`.
        load_time: that `make` may take, s.

    A late or broken process is ended; the next question begins another.
    """

    def __init__(self, make: Callable[[], object], load_time: float = START_TIMEOUT) -> None:
        self._make = make
        self._load_time = load_time
        self._process: Any = None
        self._connection: Connection | None = None

    def __getstate__(self) -> dict[str, Any]:
        """A copy, such as one for another process, has no process yet."""
        return vars(self) | {"_process": None, "_connection": None}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
            self._process = None
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _launch(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._make), daemon=True)
        with without_ctrl_c(), without_main(bytes(ForkingPickler.dumps(self._make))):
            self._process.start()
        theirs.close()
        self.call(("__repr__",), IMPORT_TIMEOUT, self._load_time)  # waits until it is made

    def call(self, question: tuple[object, ...], timeout: float, patience_then: float | None = None) -> Any:
        """Call the method named by the first part of `question` with the other parts; start the process if needed.

        The process is killed if the answer is late. Waits for a processor do not count.

        Args:
            question: Name of the method, then its arguments.
            patience: Timeout, s.
            patience_then: Timeout after each `still_at_work`, s; None for `patience`.
        """
        if self._process is None:
            self._launch()
        connection, process = self._connection, self._process
        assert connection is not None
        # From a thread of its own, since a large question to a process that does not listen blocks as well.
        watchdog = Watchdog(process, timeout)
        try:
            connection.send(question)
            while (reply := connection.recv()) is None:  # still at work
                watchdog.cancel()
                timeout = timeout if patience_then is None else patience_then
                watchdog = Watchdog(process, timeout)
        except (EOFError, OSError) as error:
            self.close()
            if watchdog.has_killed:
                raise DeadlineMissedError(f"no answer within {timeout * 1e3:g} ms") from None
            raise PolicyProcessError("the policy's process has ended") from error
        finally:
            watchdog.cancel()
        failure, answer = reply
        if failure is not None:
            raise PolicyProcessError(failure)
        return answer


def send_heartbeat() -> None:
    """Have the process that waits for a policy's answer wait on; nothing where no process does."""
    if _asking is not None:
        _asking.send(None)


def _serve(connection: Connection, make: Callable[[], object]) -> None:
    """Answer questions until the connection closes; an exception is an answer too.

    It ends with the process that began it, even while its policy hangs.
    """
    global _asking
    exit_with_parent()
    try:
        connection.send(None)  # all is imported
        try:
            policy = make()
            _asking = connection
        except Exception as error:
            connection.recv()
            connection.send((format_exception(error), None))
            return
        while True:
            call, *arguments = connection.recv()
            try:
                connection.send((None, getattr(policy, call)(*arguments)))
            except Exception as error:
                connection.send((format_exception(error), None))
    except (EOFError, OSError):
        return
