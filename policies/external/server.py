"""Server of an external policy in its subprocess: loads and calls the policy, records its failures."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Mask, Policy, PolicyError
from policies.external import onnx_file, python_file, sb3_file
from policies.external.act_function import ActFactory, ActFunction
from policies.external.network_policy import NetworkPolicy
from policies.external.reference import PolicyReference
from quad_env.cli.child_process import exit_with_parent
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import table_with

SIGNAL_NAMES = ("phase", "correction", "base_action", "stopped")
"""Names of the signals that some policies report for n robots, in addition to their actions.

- `phase`: Phase of the gait clock, (n,), rad.
- `correction`: Correction of a residual policy, as a fraction of its limit (authority), (n, 12).
- `base_action`: Joint targets of the base policy of a residual policy, (n, 12), rad.
- `stopped`: True for robots that the policy's own safety layer has stopped, (n,).
"""
FIRST_CALL_TIMEOUT_FACTOR = 6
"""Ratio of the deadline of a policy's first call to the deadline of its later calls.

The first call may take longer because some policies compile themselves in it.
"""
MAX_REASON = 200
"""Maximum number of characters of the text that describes the failure of a policy."""
HEARTBEAT_PERIOD = 1.0
"""Minimum time between two heartbeats (messages that the policy's subprocess is still at work), s.

A fifth of the deadline of a call is used instead if it is shorter. After a call of the policy, the subprocess sends a
heartbeat to its parent if this time has passed since the last heartbeat. The heartbeat restarts the timeout of the
parent, so that the calls for many robots do not exceed the timeout.
"""

_parent_connection: Connection | None = None
"""Connection to the parent process; None in a process that does not run an external policy."""


@dataclass(frozen=True)
class PolicyStepResult:
    """Result of a control step of n robots, which the policy's subprocess sends to its parent."""

    actions: Actions
    """Joint targets, (n, 12), rad; meaningless for robots for which the policy has failed."""
    failures: dict[int, str]
    """Index of each robot for which the policy failed in this step -> reason."""
    signals: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Name of each signal that the policy has, for example `phase` (SIGNAL_NAMES) -> values, one row per robot."""


def serve_requests(connection: Connection, make: Callable[[], object]) -> None:
    """Answer the method calls of the parent process until the connection closes.

    The subprocess of an external policy runs this function. A request is a tuple: the name of a method and its
    arguments. An answer is a pair: an error text or None, and the result of the method. The subprocess ends together
    with its parent, even while the policy hangs.

    Args:
        connection: Connection to the parent process.
        make: Function without arguments that makes the object with the called methods.
    """
    global _parent_connection
    exit_with_parent()
    try:
        connection.send(None)  # This heartbeat informs the parent that all modules are imported.
        try:
            served = make()
            _parent_connection = connection
        except Exception as error:
            connection.recv()
            connection.send((format_exception(error), None))
            return
        while True:
            method, *arguments = connection.recv()
            try:
                connection.send((None, getattr(served, method)(*arguments)))
            except Exception as error:
                connection.send((format_exception(error), None))
    except (EOFError, OSError):
        return


def send_heartbeat() -> None:
    """Send a heartbeat, a message that this process is still at work, to the parent process.

    The parent then restarts the timeout with which it waits for an answer. The function does nothing in a process that
    does not run an external policy.
    """
    if _parent_connection is not None:
        _parent_connection.send(None)


def make_server(reference: PolicyReference, robot: Robot, control_period: float, deadline: float) -> "PolicyServer":
    """Load an external policy, and test it by one call with the observation of an upright robot.

    Args:
        reference: Reference to the policy, from `resolve_reference`.
        robot: Robot that the policy moves.
        control_period: Control period of the environment, s.
        deadline: Maximum time of one call of the policy, s.

    Returns:
        Server of the loaded policy.

    Raises:
        PolicyError: The policy cannot be loaded, is made for another robot or control period, or returns no action.
    """
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
    server = PolicyServer(loaded, robot, deadline)
    server.smoke_test(reference)
    return server


class PolicyServer:
    """Server that calls a loaded external policy for n robots and records the robots for which it failed.

    `make_server` makes the server in the policy's subprocess. A `Policy` is called once for all robots. Any other
    callable is called once per robot.

    Args:
        loaded: Policy, or function without arguments that returns a function from one observation to one action.
        robot: Robot that the policy moves.
        deadline: Maximum time of one call, s; a fifth of it limits the time between two heartbeats.
    """

    def __init__(self, loaded: Policy | ActFactory, robot: Robot, deadline: float) -> None:
        self._loaded = loaded
        self._robot = robot
        self._deadline = deadline
        self._last_heartbeat = time.monotonic()
        self._acts: list[Any] = []
        """Functions that compute actions.

        If the user's policy is a `Policy`, the list has one function, the method `act`, which computes the actions of
        all robots. Otherwise the list has n functions, each for one of the n robots. The function of a robot is None
        if the call that makes it has failed.
        """
        self._failed = np.zeros(0, np.bool_)

    def smoke_test(self, reference: PolicyReference) -> None:
        """Call the policy once with the observation of an upright robot that stands still.

        Args:
            reference: Reference to the policy, named in the error.

        Raises:
            PolicyError: The policy raises an exception, or its action has a wrong shape.
        """
        policy = self._loaded if isinstance(self._loaded, Policy) else None
        table = table_with(self._robot, None if policy is None else policy.height_scan)
        upright = np.zeros((1, table.size), np.float32)
        upright[:, table.slices["projected_gravity"].stop - 1] = -1.0
        observation = upright[0] if policy is None else upright
        action_shape = (*observation.shape[:-1], self._robot.num_joints)
        reason = self.reset(1, 0).get(0) or self._compute_action(self._acts[0], observation, action_shape)[1]
        if reason is not None:
            expected = f"an action {action_shape} for an observation {observation.shape}"
            raise PolicyError(f"{reference} must give {expected}; it {reason}")

    def servo_gains(self) -> Floats | None:
        """Return the servo gains of a `Policy`, (2, 12): stiffness, N·m/rad, and damping, N·m·s/rad.

        Other callables command the servos of the robot as they are; the result is then None.
        """
        return self._loaded.robot.gains if isinstance(self._loaded, Policy) else None

    def reset(self, num_envs: int, seed: int | None) -> dict[int, str]:
        """Reset the policy for n robots.

        Args:
            num_envs: Number of robots, n.
            seed: Seed of a `Policy`; other callables have no seed.

        Returns:
            Index of each robot for which the reset of the policy failed -> reason as a text.
        """
        self._failed = np.zeros(num_envs, np.bool_)
        if isinstance(self._loaded, Policy):
            self._acts = [self._loaded.act]
            _, reason = self._call(self._loaded.reset, num_envs, seed)
            return self._record_failures(range(num_envs), reason)
        self._acts = [None] * num_envs
        return self.reset_where(np.ones(num_envs, np.bool_))

    def reset_where(self, mask: Mask) -> dict[int, str]:
        """Reset the policy for the robots for which `mask`, (n,), is True.

        Returns a dictionary: index of each robot for which the reset failed -> reason as a text.
        """
        self._failed[mask] = False
        if isinstance(self._loaded, Policy):
            _, reason = self._call(self._loaded.reset_where, mask)
            return self._record_failures(range(len(mask)), reason)
        failures: dict[int, str] = {}
        for robot in np.flatnonzero(mask).tolist():
            self._acts[robot], reason = self._call(self._loaded)
            failures |= self._record_failures([robot], reason)
        return failures

    def step(self, observation: NDArray[np.float32]) -> PolicyStepResult:
        """Compute the actions for the observations of all robots, (n, k).

        Returns the actions, the failures in this step, and the policy's signals. A policy that is called per robot is
        not called for robots for which it has failed earlier.
        """
        count = len(observation)
        joints = self._robot.num_joints
        actions = np.zeros((count, joints), np.float32)
        failures: dict[int, str] = {}
        if not isinstance(self._loaded, Policy):
            for robot in np.flatnonzero(~self._failed).tolist():
                action, reason = self._compute_action(self._acts[robot], observation[robot], (joints,))
                failures |= self._record_failures([robot], reason)
                if action is not None:
                    actions[robot] = action
        elif not self._failed.all():
            action, reason = self._compute_action(self._acts[0], observation, actions.shape)
            failures |= self._record_failures(range(count), reason)
            actions = actions if action is None else action
        nonfinite = np.flatnonzero(~np.isfinite(actions).all(axis=1) & ~self._failed).tolist()
        failures |= self._record_failures(nonfinite, "gave targets that are not finite")
        return PolicyStepResult(actions, failures, self.signals())

    def signals(self) -> dict[str, NDArray[Any]]:
        """Return the signals that the policy has: name, for example `phase` (SIGNAL_NAMES) -> one row per robot."""
        signals = {}
        for name in SIGNAL_NAMES if isinstance(self._loaded, Policy) else ():
            value, _ = self._call(lambda name=name: np.array(getattr(self._loaded, name)))
            width = (self._robot.num_joints,) if name in ("correction", "base_action") else ()
            if value is not None and value.dtype.kind in "fb" and value.shape == (len(self._failed), *width):
                signals[name] = value
        return signals

    def _record_failures(self, robots: Iterable[int], reason: str | None) -> dict[int, str]:
        """Record that the policy failed for the robots with the indices `robots`, if `reason` is not None.

        Returns a dictionary: index of each robot without an earlier failure -> reason.
        """
        new = [] if reason is None else [robot for robot in robots if not self._failed[robot]]
        self._failed[new] = True
        return dict.fromkeys(new, reason or "")

    def _compute_action(
        self, act: ActFunction, observation: NDArray[np.float32], shape: tuple[int, ...]
    ) -> tuple[Actions | None, str | None]:
        """Call the policy function `act`, and check that its action consists of numbers and has `shape`.

        Returns the action and None, or None and the reason of the failure.
        """
        action, reason = self._call(lambda: np.asarray(act(observation)))
        if reason is not None:
            return None, reason
        if action.shape != shape or action.dtype.kind not in "fiu":
            return None, f"gave {action.dtype} of shape {action.shape}, not numbers of shape {shape}"
        with np.errstate(over="ignore"):
            return action.astype(np.float32), None

    def _call(self, call: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:
        """Call a function of the policy; return its result and None, or None and the reason of its failure.

        The call has no time limit here, because the parent kills this process if the call takes too long
        (`PolicyProcess`).
        """
        try:
            return call(*arguments), None
        except BaseException as error:  # SystemExit is caught too, because the other robots still need this process.
            return None, f"raised {format_exception(error)}"[:MAX_REASON]
        finally:
            now = time.monotonic()
            if now - self._last_heartbeat > min(HEARTBEAT_PERIOD, 0.2 * self._deadline):
                self._last_heartbeat = now
                send_heartbeat()
