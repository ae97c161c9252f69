"""A policy from outside, in a watched process of its own: its failures cost its own robots the episode, no others."""

import os
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Mask, Policy, PolicyError, PolicyKwargs, within_limits
from policies.external.network_policy import with_spec_gains
from policies.external.observation_adapter import required_height_scan
from policies.external.reference import resolve_reference
from policies.external.server import FIRST_CALL_TIMEOUT_FACTOR, SIGNAL_NAMES, PolicyServer, StepResult, make_server
from policies.external.spec import PolicySpec
from policies.external.watched import START_TIMEOUT, DeadlineMissedError, PolicyProcess, PolicyProcessError

ACT_DEADLINE = 5.0
"""Longest time that one call may take, s; six times as long for the first."""
LOAD_TIMEOUT = "QUAD_ENV_LOAD_TIMEOUT"
"""Environment variable: limit in place of START_TIMEOUT, s."""
ACT_TIMEOUT = "QUAD_ENV_ACT_TIMEOUT"
"""Environment variable: limit in place of DEADLINE, s."""
KILL_GRACE_PERIOD = 2.0
"""Added to the deadline before a process without an answer is ended, s; the episodes of all its robots then fail."""


class ExternalPolicy(Policy):
    """The policy of `my_file.py:NAME`, or of another file; robots that it fails hold the home pose.

    Args:
        reference: names it.
        robot: whose joints it moves; its own `robot` has the servo gains of its description.
        trust: whether a file may be loaded in which code can be hidden.

    The attributes named in SIGNALS are its policy's, None where this has none. Raises PolicyError, one line, for what
    is no policy.
    """

    failure: NDArray[np.object_]
    """Why the policy failed each robot, (n,); None where it has not."""
    spec: PolicySpec | None = None
    """How its network is run; None of a policy that acts on our observation by itself."""
    remarks: tuple[str, ...]
    """Assumptions where its files are incomplete, a line each."""

    def __init__(self, reference: str | Path, *, trust: bool = False, **made_for: Unpack[PolicyKwargs]) -> None:
        super().__init__(**made_for)
        found = resolve_reference(reference, trust)
        if found.spec is not None:
            self.robot, self.spec = with_spec_gains(self.robot, found.spec), found.spec
            self.height_scan = required_height_scan(found.spec)
        self.name = str(reference)
        self.remarks = found.remarks if found.spec is None else found.spec.remarks
        self.sha256 = found.sha256
        served = partial(make_server, found, self.robot, self.control_period, _seconds(ACT_TIMEOUT, ACT_DEADLINE))
        load_time = _seconds(LOAD_TIMEOUT, START_TIMEOUT)
        self._process = PolicyProcess(partial(_on_stderr, served), load_time)
        self._stepped = False
        self._try_out()
        self._allocate(1)

    def __getstate__(self) -> dict[str, Any]:
        """A copy, such as one for another process, has no process yet."""
        return vars(self) | {"_stepped": False}

    def _try_out(self) -> None:
        """Raise PolicyError where the policy cannot be loaded, or gives no actions."""
        try:
            self._process.call(("reset", 1, None), _seconds(LOAD_TIMEOUT, START_TIMEOUT))
        except (DeadlineMissedError, PolicyProcessError) as error:
            reason = str(error).removeprefix("PolicyError: ")
            raise PolicyError(reason if reason != str(error) else f"cannot load {self.name}: {reason}") from None
        finally:
            self._process.close()

    def close(self) -> None:
        """End its process; `reset` begins another."""
        self._process.close()
        self._stepped = False

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Restart the policy for `num_envs` robots."""
        super().reset(num_envs, seed)
        self._note(self._asked("reset", num_envs, seed) or {})
        vars(self).update(self._asked("signals") or {})

    def _allocate(self, num_envs: int) -> None:
        self.failure = np.full(num_envs, None, dtype=object)
        vars(self).update(dict.fromkeys(SIGNAL_NAMES))

    def _reset_rows(self, mask: Mask) -> None:
        self.failure[mask] = None
        self._note(self._asked("reset_where", mask) or {})

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        answer: StepResult | None = None
        if any(reason is None for reason in self.failure):
            answer = self._asked("step", observation)
        home = np.tile(self.robot.home_pose.astype(np.float32), (self.num_envs, 1))
        if answer is None:
            return home
        self._note(answer.failures)
        vars(self).update({name: value for name, value in answer.signals.items() if getattr(self, name) is not None})
        good = np.array([reason is None for reason in self.failure])
        return within_limits(self.robot, np.where(good[:, None], answer.actions, home))

    def _asked(self, call: str, *arguments: object) -> Any:
        """What its process answers; None, and no robot has a policy any more, if the process is gone."""
        timeout = _seconds(ACT_TIMEOUT, ACT_DEADLINE) * (1 if self._stepped else FIRST_CALL_TIMEOUT_FACTOR)
        try:
            answer = self._process.call((call, *arguments), timeout + KILL_GRACE_PERIOD)
            self._stepped |= call == "step"
            return answer
        except DeadlineMissedError:
            reason = f"gave no answer within {timeout:g} s"
        except PolicyProcessError as error:
            reason = f"gave no answer: {error}"
        self._stepped = False
        self._note(dict.fromkeys(range(self.num_envs), reason))
        return None

    def _note(self, failures: dict[int, str]) -> None:
        for robot, reason in failures.items():
            if self.failure[robot] is None:
                self.failure[robot] = reason


def _seconds(variable: str, otherwise: float) -> float:
    """Return the time in an environment variable, s."""
    given = os.environ.get(variable, "")
    return float(given) if re.fullmatch(r"[0-9]{1,6}(\.[0-9]+)?", given) and float(given) > 0 else otherwise


def _on_stderr(make: Callable[[], PolicyServer]) -> PolicyServer:
    """What `make` gives, in a process that from now on prints on stderr."""
    sys.stdout = sys.stderr
    return make()
