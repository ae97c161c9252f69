"""A policy in a process of its own, watched from outside: whatever it does, an answer is there in time."""

import multiprocessing
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, Policy
from quad_env.cli.child_process import serve_parent, without_ctrl_c
from quad_env.files.text import described
from quad_env.robots.named import robot_of
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

START_TIMEOUT = 60.0
"""For the process to start and make its policy, s."""

_asking: Connection | None = None
"""In a policy's process: the connection to the process that asks it."""


class DeadlineMissed(RuntimeError):
    """The policy gave no answer in time; its process has been ended."""


class PolicyProcessError(RuntimeError):
    """The policy raised an exception in its process, or the process is gone; the message says which."""


class Watched(Policy):
    """A policy that may hang: within `deadline` s `act` answers or raises, even if the policy never returns.

    Args:
        make: makes the policy, in the other process; picklable, such as `functools.partial(policies.make, "trot")`.
        deadline: for an answer, s; half a control period, the default, leaves the other half for what has to be done
            instead.
        robot, control_period: those that the policy was made for.

    A late or broken process is ended, and every later `act` raises at once; `reset` starts a fresh one.
    """

    def __init__(
        self,
        make: Callable[[], Policy],
        deadline: float | None = None,
        name: str = "watched",
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        robot = robot_of(robot)
        super().__init__(robot=robot, control_period=control_period)
        if deadline is not None and not deadline > 0.0:
            raise ValueError(f"deadline must be positive, not {deadline}")
        self._deadline = 0.5 * control_period if deadline is None else deadline
        self._make, self.name = make, name
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

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Restart the policy for `num_envs` robots, in a fresh process if there is none."""
        super().reset(num_envs, seed)
        if self._process is None:
            self._launch()
        self.ask(("reset", num_envs, seed), START_TIMEOUT)

    def _launch(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._make), daemon=True)
        with without_ctrl_c():
            self._process.start()
        theirs.close()
        self.ask(("check_fits", self.robot, self.control_period), START_TIMEOUT)

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        if self._process is None:
            self._launch()
            self.ask(("reset", self.num_envs, None), START_TIMEOUT)
        else:
            self.ask(("reset_where", mask), self._deadline)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        if self._process is None:
            raise PolicyProcessError("the policy's process is not running; reset starts it")
        answer: Actions = self.ask(("act", observation), self._deadline)
        return answer

    def ask(self, question: tuple[object, ...], patience: float) -> Any:
        """What a method of the policy, named first, gives for the arguments after it, in a process begun if need be.

        The process is ended unless the answer comes within `patience` s, or within as much of the last `still_at_work`.
        """
        if self._process is None:
            self._launch()
        connection, process = self._connection, self._process
        assert connection is not None
        # From a thread of its own, since a large question to a process that does not listen blocks as well.
        watchdog, began = threading.Timer(patience, process.kill), time.perf_counter()
        watchdog.start()
        try:
            connection.send(question)
            while (reply := connection.recv()) is None:  # still at work
                watchdog.cancel()
                watchdog.join()
                watchdog, began = threading.Timer(patience, process.kill), time.perf_counter()
                watchdog.start()
        except (EOFError, OSError) as error:
            late = time.perf_counter() - began >= patience
            self.close()
            if late:
                raise DeadlineMissed(f"no answer within {patience * 1e3:g} ms") from None
            raise PolicyProcessError("the policy's process has ended") from error
        finally:
            watchdog.cancel()
            watchdog.join()
        failure, answer = reply
        if failure is not None:
            raise PolicyProcessError(failure)
        return answer


def still_at_work() -> None:
    """Have the process that waits for a policy's answer wait on; nothing where no process does."""
    if _asking is not None:
        _asking.send(None)


def _serve(connection: Connection, make: Callable[[], Policy]) -> None:
    """Answer questions until the connection closes; an exception is an answer too.

    It ends with the process that began it, even while its policy hangs.
    """
    global _asking
    serve_parent()
    try:
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
