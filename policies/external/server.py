"""A policy from outside as its process serves it, its failures noted."""

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Mask, Policy, PolicyError
from policies.external import onnx_file, python_file, sb3_file
from policies.external.network_policy import NetworkPolicy
from policies.external.python_file import ActFactory, ActFunction
from policies.external.reference import PolicyReference
from policies.external.watched import send_heartbeat
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import table_with

SIGNAL_NAMES = ("phase", "correction", "base_action", "stopped")
"""Signals that some policies report: phase of the clock, rad, (n,); of a residual the correction, in shares of its
authority, and its base's joint targets, rad, (n, 12) each; which robots it has stopped itself, (n,)."""
FIRST_CALL_TIMEOUT_FACTOR = 6
"""How many deadlines the first call may last, in which some compile themselves."""
MAX_REASON = 200
REPORT_PERIOD = 1.0
"""At most, between two signs of life while many robots are asked, s."""


@dataclass(frozen=True)
class StepResult:
    """What came of a control step of n robots."""

    actions: Actions
    """Joint targets, rad, (n, 12); nothing of robots that the policy has failed."""
    failures: dict[int, str]
    """Robot -> why the policy failed it in this step."""
    signals: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Those of SIGNALS that there are."""


def make_server(reference: PolicyReference, robot: Robot, control_period: float, deadline: float) -> "PolicyServer":
    """The policy of a reference, loaded and tried. Raises PolicyError."""
    loaded: Policy | ActFactory
    if reference.spec is not None:
        loaded = NetworkPolicy(reference.spec, robot=robot, control_period=control_period)
    elif reference.suffix == ".py":
        loaded = python_file.load_python(reference, robot, control_period)
    elif reference.suffix == ".zip":
        loaded = sb3_file.load_sb3(reference, robot)
    else:
        loaded = onnx_file.load_onnx(reference, robot)
    if isinstance(loaded, Policy) and (misfit := loaded.mismatch(robot, control_period)):
        raise PolicyError(f"{reference} is {misfit}")
    served = PolicyServer(loaded, robot, deadline)
    served.smoke_test(reference)
    return served


class PolicyServer:
    """Robots' actions, and what went wrong instead: a `Policy` is asked for all robots, a callable for each."""

    def __init__(self, loaded: Policy | ActFactory, robot: Robot, deadline: float) -> None:
        self._loaded, self._robot = loaded, robot
        self._deadline = deadline
        self._reported = time.monotonic()
        self._acts: list[Any] = []
        """Of a `Policy` its own alone, else one a robot; None where none could be made."""
        self._failed = np.zeros(0, np.bool_)

    def smoke_test(self, reference: PolicyReference) -> None:
        """Raise PolicyError unless it gives an action for an upright robot at rest."""
        policy = self._loaded if isinstance(self._loaded, Policy) else None
        table = table_with(self._robot, None if policy is None else policy.height_scan)
        upright = np.zeros((1, table.size), np.float32)
        upright[:, table.slices["projected_gravity"].stop - 1] = -1.0
        shown = upright[0] if policy is None else upright
        wanted = (*shown.shape[:-1], self._robot.num_joints)
        reason = self.reset(1, 0).get(0) or self._ask(self._acts[0], shown, wanted)[1]
        if reason is not None:
            raise PolicyError(f"{reference} must give an action {wanted} for an observation {shown.shape}; it {reason}")

    def reset(self, num_envs: int, seed: int | None) -> dict[int, str]:
        """Restart the policy for so many robots; why it failed, by robot."""
        self._failed = np.zeros(num_envs, np.bool_)
        if isinstance(self._loaded, Policy):
            self._acts = [self._loaded.act]
            _, reason = self._tried(self._loaded.reset, num_envs, seed)
            return self._fail(range(num_envs), reason)
        self._acts = [None] * num_envs
        return self.reset_where(np.ones(num_envs, np.bool_))

    def reset_where(self, mask: Mask) -> dict[int, str]:
        """Restart those robots."""
        self._failed[mask] = False
        if isinstance(self._loaded, Policy):
            _, reason = self._tried(self._loaded.reset_where, mask)
            return self._fail(range(len(mask)), reason)
        failures: dict[int, str] = {}
        for robot in np.flatnonzero(mask).tolist():
            self._acts[robot], reason = self._tried(self._loaded)
            failures |= self._fail([robot], reason)
        return failures

    def step(self, observation: NDArray[np.float32]) -> StepResult:
        """Actions for the observations (n, k) of all robots."""
        count, joints = len(observation), self._robot.num_joints
        actions, failures = np.zeros((count, joints), np.float32), dict[int, str]()
        if not isinstance(self._loaded, Policy):
            for robot in np.flatnonzero(~self._failed).tolist():
                answer, reason = self._ask(self._acts[robot], observation[robot], (joints,))
                failures |= self._fail([robot], reason)
                if answer is not None:
                    actions[robot] = answer
        elif not self._failed.all():
            answer, reason = self._ask(self._acts[0], observation, actions.shape)
            failures |= self._fail(range(count), reason)
            actions = actions if answer is None else answer
        nonfinite = np.flatnonzero(~np.isfinite(actions).all(axis=1) & ~self._failed).tolist()
        failures |= self._fail(nonfinite, "gave targets that are not finite")
        return StepResult(actions, failures, self.signals())

    def signals(self) -> dict[str, NDArray[Any]]:
        """Those of SIGNALS that the policy has, each of n robots."""
        found = {}
        for name in SIGNAL_NAMES if isinstance(self._loaded, Policy) else ():
            value, _ = self._tried(lambda name=name: np.array(getattr(self._loaded, name)))
            width = (self._robot.num_joints,) if name in ("correction", "base_action") else ()
            if value is not None and value.dtype.kind in "fb" and value.shape == (len(self._failed), *width):
                found[name] = value
        return found

    def _fail(self, robots: Any, reason: str | None) -> dict[int, str]:
        """Take note of why robots have no action any more, if there is a reason; those that had none before."""
        new = [] if reason is None else [robot for robot in robots if not self._failed[robot]]
        self._failed[new] = True
        return dict.fromkeys(new, reason or "")

    def _ask(
        self, act: ActFunction, shown: NDArray[np.float32], wanted: tuple[int, ...]
    ) -> tuple[Actions | None, str | None]:
        """The action of that shape, or why there is none."""
        answer, reason = self._tried(lambda: np.asarray(act(shown)))
        if reason is not None:
            return None, reason
        if answer.shape != wanted or answer.dtype.kind not in "fiu":
            return None, f"gave {answer.dtype} of shape {answer.shape}, not numbers of shape {wanted}"
        with np.errstate(over="ignore"):
            return answer.astype(np.float32), None

    def _tried(self, call: Any, *arguments: Any) -> tuple[Any, str | None]:
        """The result of a call, or why it has none.

        A call without an end is not ended here: the process that waits for the answer ends this one, see `Foreign`.
        """
        try:
            return call(*arguments), None
        except BaseException as error:  # SystemExit as well: it must not end the process with the other robots
            return None, f"raised {format_exception(error)}"[:MAX_REASON]
        finally:
            if (now := time.monotonic()) - self._reported > min(REPORT_PERIOD, 0.2 * self._deadline):
                self._reported = now
                send_heartbeat()
