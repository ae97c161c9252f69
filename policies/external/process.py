"""Parent's side of external policies, which run in a subprocess with a timeout on every call.

A failure of the policy ends only the episodes of the robots that the policy controls.
"""

import multiprocessing
import os
import re
import sys
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Mask, Policy, PolicyError, PolicyKwargs, within_limits
from policies.external.network_policy import with_spec_gains
from policies.external.observation_adapter import required_height_scan
from policies.external.reference import resolve_reference
from policies.external.server import (
    FIRST_CALL_TIMEOUT_FACTOR,
    SIGNAL_NAMES,
    PolicyServer,
    PolicyStepResult,
    make_server,
    serve_requests,
)
from policies.external.spec import PolicySpec
from quad_env.cli.child_process import Watchdog, without_ctrl_c, without_main

START_TIMEOUT = 60.0
"""Maximum time in which the subprocess loads its policy after the imports, s.

Time in which the subprocess waits for a processor core does not count.
"""
IMPORT_TIMEOUT = 300.0
"""Maximum time in which the subprocess of a policy starts and imports this project's modules, s."""
ACT_DEADLINE = 5.0
"""Maximum time of one call of the policy, s.

The first call may take six times as long (FIRST_CALL_TIMEOUT_FACTOR).
"""
KILL_GRACE_PERIOD = 2.0
"""Time after the deadline of a call, until a subprocess that has not answered is killed, s.

If the subprocess is killed, the episodes of all robots that the policy controls fail.
"""
LOAD_TIMEOUT = "QUAD_ENV_LOAD_TIMEOUT"
"""Name of the environment variable that replaces START_TIMEOUT, the maximum time to load a policy, s."""
ACT_TIMEOUT = "QUAD_ENV_ACT_TIMEOUT"
"""Name of the environment variable that replaces ACT_DEADLINE, the maximum time of one call of the policy, s."""


class DeadlineMissedError(RuntimeError):
    """Raised when a policy's subprocess did not answer a call in time and was killed."""


class PolicyProcessError(RuntimeError):
    """Raised when a called method raised an exception in the policy's subprocess, or the subprocess ended.

    The message describes the exception, or states that the subprocess has ended.
    """


class PolicyProcess:
    """Proxy of an object in a subprocess, with a timeout on every call.

    A subprocess that exceeds a timeout is killed. After a timeout or a crash, the next call starts another subprocess.

    Args:
        make: Function without arguments that makes the object in the subprocess. It must be picklable, for example
            `functools.partial(policies.make, "trot")`.
        load_time: Maximum time of `make()` in the subprocess, s.
    """

    def __init__(self, make: Callable[[], object], load_time: float = START_TIMEOUT) -> None:
        self._make = make
        self._load_time = load_time
        self._process: Any = None
        self._connection: Connection | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for pickle or copy, except the subprocess; a copy starts its own subprocess."""
        return vars(self) | {"_process": None, "_connection": None}

    def close(self) -> None:
        """End the subprocess."""
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
        self._connection, child_connection = context.Pipe()
        self._process = context.Process(target=serve_requests, args=(child_connection, self._make), daemon=True)
        with without_ctrl_c(), without_main(bytes(ForkingPickler.dumps(self._make))):
            self._process.start()
        child_connection.close()
        # This call waits until the object is made, because the subprocess answers only after that.
        self.call(("__repr__",), IMPORT_TIMEOUT, self._load_time)

    def call(self, request: tuple[object, ...], timeout: float, heartbeat_timeout: float | None = None) -> Any:
        """Call a method of the object in the subprocess, which is started if needed.

        The subprocess is killed if the answer is late. Time in which the subprocess waits for a processor core does not
        count. A busy subprocess sends heartbeats (messages that it is still at work), which restart the timeout.

        Args:
            request: Name of the method, then its arguments.
            timeout: Maximum time until the answer or the first heartbeat, s.
            heartbeat_timeout: Maximum time after each heartbeat, s; None: the same as `timeout`.

        Returns:
            Result of the called method.

        Raises:
            DeadlineMissedError: No answer came in time; the subprocess was killed.
            PolicyProcessError: The method raised an exception, or the subprocess died.
        """
        if self._process is None:
            self._launch()
        connection = self._connection
        process = self._process
        assert connection is not None
        # The watchdog has its own thread because sending a large request blocks until the subprocess receives it.
        watchdog = Watchdog(process, timeout)
        try:
            connection.send(request)
            while (reply := connection.recv()) is None:  # None is a heartbeat: the subprocess is still busy.
                watchdog.cancel()
                timeout = timeout if heartbeat_timeout is None else heartbeat_timeout
                watchdog = Watchdog(process, timeout)
        except (EOFError, OSError) as error:
            self.close()
            if watchdog.has_killed:
                raise DeadlineMissedError(f"no answer within {timeout * 1e3:g} ms") from None
            raise PolicyProcessError("the policy's process has ended") from error
        finally:
            watchdog.cancel()
        failure, result = reply
        if failure is not None:
            raise PolicyProcessError(failure)
        return result


class ExternalPolicy(Policy):
    """Policy from a user's file or another project's file, run in a subprocess.

    The file is a Python file (`my_file.py:NAME`), a network, a specification file, or a model of Stable-Baselines3. A
    robot for which the policy has failed holds the home pose. The policy's signals are attributes, for example
    `phase`, the phase of its gait clock (SIGNAL_NAMES lists all signals). A signal that the policy lacks is None. The
    constructor raises PolicyError, one line, if the policy cannot be loaded.

    Args:
        reference: Path of the policy's file, or `FILE.py:NAME` for a class or object in a Python file.
        trust: True to load files in which code can be hidden, for example pickles.
        **made_for: Robot and control period. The attribute `robot` has the servo gains of the policy's specification,
            or of the `Policy` in a Python file.
    """

    failure: NDArray[np.object_]
    """Reason for the policy's failure as a text, one per robot, (n,); None for robots without a failure."""
    spec: PolicySpec | None = None
    """Specification of the policy's network; None if its input is the environment's own observation."""
    remarks: tuple[str, ...]
    """Assumptions made because the policy's files are incomplete, one line each."""

    def __init__(self, reference: str | Path, *, trust: bool = False, **made_for: Unpack[PolicyKwargs]) -> None:
        super().__init__(**made_for)
        resolved = resolve_reference(reference, trust)
        if resolved.spec is not None:
            self.robot = with_spec_gains(self.robot, resolved.spec)
            self.spec = resolved.spec
            self.height_scan = required_height_scan(resolved.spec)
        self.name = str(reference)
        self.remarks = resolved.remarks if resolved.spec is None else resolved.spec.remarks
        self.sha256 = resolved.sha256
        make = partial(make_server, resolved, self.robot, self.control_period, _time_limit(ACT_TIMEOUT, ACT_DEADLINE))
        load_time = _time_limit(LOAD_TIMEOUT, START_TIMEOUT)
        self._process = PolicyProcess(partial(_make_with_stderr, make), load_time)
        self._stepped = False
        self._smoke_test()
        self._allocate(1)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for pickle or copy; the copy starts its own subprocess."""
        return vars(self) | {"_stepped": False}

    def check_loads(self) -> None:
        """Raise PolicyError if the policy cannot be loaded by this process, which has a copy of the policy's files."""
        self._smoke_test()

    def _smoke_test(self) -> None:
        """Load the policy in a subprocess, and raise PolicyError if it cannot be loaded or returns no action.

        The attribute `robot` gets the servo gains that the policy commands. The subprocess is ended afterwards.
        """
        try:
            self._process.call(("reset", 1, None), _time_limit(LOAD_TIMEOUT, START_TIMEOUT))
            gains = self._process.call(("servo_gains",), _time_limit(LOAD_TIMEOUT, START_TIMEOUT))
        except (DeadlineMissedError, PolicyProcessError) as error:
            reason = str(error).removeprefix("PolicyError: ")
            raise PolicyError(reason if reason != str(error) else f"cannot load {self.name}: {reason}") from None
        finally:
            self._process.close()
        if gains is not None and not self.robot.has_gains(gains):
            self.robot = self.robot.with_servo(*gains)

    def close(self) -> None:
        """End the policy's subprocess; the next call of `reset` starts another one."""
        self._process.close()
        self._stepped = False

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset the policy for n robots.

        Args:
            num_envs: Number of robots, n.
            seed: Seed of the policy's random numbers; None: no seed.
        """
        super().reset(num_envs, seed)
        self._record_failures(self._request("reset", num_envs, seed) or {})
        vars(self).update(self._request("signals") or {})

    def _allocate(self, num_envs: int) -> None:
        self.failure = np.full(num_envs, None, dtype=object)
        vars(self).update(dict.fromkeys(SIGNAL_NAMES))

    def _reset_rows(self, mask: Mask) -> None:
        self.failure[mask] = None
        self._record_failures(self._request("reset_where", mask) or {})

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        result: PolicyStepResult | None = None
        if any(reason is None for reason in self.failure):
            result = self._request("step", observation)
        home = np.tile(self.robot.home_pose.astype(np.float32), (self.num_envs, 1))
        if result is None:
            return home
        self._record_failures(result.failures)
        vars(self).update({name: value for name, value in result.signals.items() if getattr(self, name) is not None})
        is_working = np.array([reason is None for reason in self.failure])
        return within_limits(self.robot, np.where(is_working[:, None], result.actions, home))

    def _request(self, method: str, *arguments: object) -> Any:
        """Call a method of the `PolicyServer` in the subprocess, and return its result.

        If no result comes, a failure is recorded for every robot and None is returned.
        """
        timeout = _time_limit(ACT_TIMEOUT, ACT_DEADLINE) * (1 if self._stepped else FIRST_CALL_TIMEOUT_FACTOR)
        try:
            answer = self._process.call((method, *arguments), timeout + KILL_GRACE_PERIOD)
            self._stepped |= method == "step"
            return answer
        except DeadlineMissedError:
            reason = f"gave no answer within {timeout:g} s"
        except PolicyProcessError as error:
            reason = f"gave no answer: {error}"
        self._stepped = False
        self._record_failures(dict.fromkeys(range(self.num_envs), reason))
        return None

    def _record_failures(self, failures: dict[int, str]) -> None:
        for robot, reason in failures.items():
            if self.failure[robot] is None:
                self.failure[robot] = reason


def _time_limit(variable: str, default: float) -> float:
    """Return the time limit in an environment variable, s.

    Returns `default` if the variable is missing or is not a positive number.
    """
    text = os.environ.get(variable, "")
    return float(text) if re.fullmatch(r"[0-9]{1,6}(\.[0-9]+)?", text) and float(text) > 0 else default


def _make_with_stderr(make: Callable[[], PolicyServer]) -> PolicyServer:
    """Return the server that `make` makes, after redirecting standard output to standard error.

    Text that the policy prints thus does not enter the standard output of the command.
    """
    sys.stdout = sys.stderr
    return make()
