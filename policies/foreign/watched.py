"""A policy in a process of its own, watched from outside: whatever it does, an answer or an error comes in time."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any

from quad_env.cli.child_process import Watchdog, serve_parent, without_ctrl_c, without_main
from quad_env.files.text import described

START_TIMEOUT = 60.0
"""For the process to make its policy, s; time in which it waits for a processor does not count."""
IMPORT_TIMEOUT = 300.0
"""For the process to start and to load the project, s."""

_asking: Connection | None = None
"""In a policy's process: the connection to the process that asks it."""


class DeadlineMissed(RuntimeError):
    """The policy gave no answer in time; its process has been ended."""


class PolicyProcessError(RuntimeError):
    """The policy raised an exception in its process, or the process is gone; the message says which."""


class Watched:
    """An object in a process of its own, whose methods can be asked for within a time, even if they never return.

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
        self.ask(("__repr__",), IMPORT_TIMEOUT, self._load_time)  # waits until it is made

    def ask(self, question: tuple[object, ...], patience: float, patience_then: float | None = None) -> Any:
        """What a method of the object, named first, gives for the arguments after it, in a process begun if need be.

        The process is ended unless the answer comes within `patience` s, or within `patience_then` s (by default as
        much) of the last `still_at_work`. Time in which it waits for a processor does not count.
        """
        if self._process is None:
            self._launch()
        connection, process = self._connection, self._process
        assert connection is not None
        # From a thread of its own, since a large question to a process that does not listen blocks as well.
        watchdog = Watchdog(process, patience)
        try:
            connection.send(question)
            while (reply := connection.recv()) is None:  # still at work
                watchdog.call_off()
                patience = patience if patience_then is None else patience_then
                watchdog = Watchdog(process, patience)
        except (EOFError, OSError) as error:
            self.close()
            if watchdog.has_bitten:
                raise DeadlineMissed(f"no answer within {patience * 1e3:g} ms") from None
            raise PolicyProcessError("the policy's process has ended") from error
        finally:
            watchdog.call_off()
        failure, answer = reply
        if failure is not None:
            raise PolicyProcessError(failure)
        return answer


def still_at_work() -> None:
    """Have the process that waits for a policy's answer wait on; nothing where no process does."""
    if _asking is not None:
        _asking.send(None)


def _serve(connection: Connection, make: Callable[[], object]) -> None:
    """Answer questions until the connection closes; an exception is an answer too.

    It ends with the process that began it, even while its policy hangs.
    """
    global _asking
    serve_parent()
    try:
        connection.send(None)  # all is loaded
        try:
            policy = make()
            _asking = connection
        except Exception as error:
            connection.recv()
            connection.send((described(error), None))
            return
        while True:
            call, *arguments = connection.recv()
            try:
                connection.send((None, getattr(policy, call)(*arguments)))
            except Exception as error:
                connection.send((described(error), None))
    except (EOFError, OSError):
        return
