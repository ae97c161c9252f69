"""Safety layer of a policy: stops the robot after failures, braces before falls, limits the targets."""

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Actions, Floats, Mask, Policy, to_actions, validate_mask
from policies.behaviour.motion import Damp, Motion, Stop
from policies.memory import initialize_state, per_robot
from policies.safety.brace import Brace
from policies.safety.target_limits import SafetyLimits
from quad_env import OBSERVATION
from quad_env.files.text import format_exception


class Mode(IntEnum):
    """Mode of the safety layer for a robot; the mode determines where the joint targets come from."""

    FOLLOW = 0
    """The policy determines the joint targets."""
    CATCH = 1
    """After a predicted fall, the brace (low, wide stance) determines the joint targets.

    The mode ends when the robot is at rest, or when its trunk tilts by more than MAX_TILT."""
    STOP = 2
    """After a failure or an emergency stop, a controlled stop determines the joint targets: the trunk sinks slowly.

    The mode lasts until a reset, or until the robot tilts by more than MAX_TILT."""
    DAMP = 3
    """The servos only damp the motion of the joints, until a reset.

    A robot gets this mode if its trunk tilts by more than MAX_TILT in the mode STOP, or by an emergency stop with
    damping."""


TOO_FAR_OVER = "too far over"
"""Text in `Safe.reason` if the mode of a robot has changed because its trunk tilts by more than MAX_TILT."""

MAX_TILT = np.deg2rad(65.0)
"""Tilt of the trunk above which neither the brace nor a controlled stop can work, rad.

The value is 5° below the tilt at which the environment counts a fall, `FallRule.tilt`."""
FALL_ALARM_DEVIATION = 0.8866
"""Deviation of the trunk velocity, see `velocity_deviation`, above which a fall is predicted, m/s.

The value is 0.2 m/s above the largest deviation in one hour of trot without a disturbance."""
RESPONSE_TIME = 0.25
"""Time constant with which a walking robot is expected to reach the velocity of a new command, s."""
RECENT_TIME = 0.1
"""Time constant of the low-pass filter of the measured velocity, s.

A push shows as a difference between the measured and the filtered velocity. The filter follows slower changes, so that
these do not count as a push."""


class Safe(Policy):
    """Policy inside a safety layer, which takes over after a predicted fall or a failure of the policy.

    The property `mode` is the mode of the safety layer for each robot. The attribute `reason` is the reason of the last
    change of the mode.

    Args:
        policy: Policy inside the safety layer.
        limits: Limits of all joint targets; None for the limits of the robot with ideal actuators.
    """

    reason: NDArray[np.object_] = per_robot(np.array("", object))
    """Reason of the last change of mode of each robot, text, (n,); empty after a reset."""
    _mode: NDArray[np.int8] = per_robot(np.int8(Mode.FOLLOW))
    """Number of the current `Mode` of each robot, (n,)."""
    _entered: Mask = per_robot(False)
    """True for robots that have changed their mode since the last action, (n,)."""
    _targets: Floats = per_robot()
    """Joint targets of the last action, (n, 12), rad; the home pose after a reset."""
    _reference: Floats = per_robot(np.zeros(2))
    """Horizontal velocity that each robot is expected to have, base frame, (n, 2), m/s.

    The expected velocity is the commanded velocity after a low-pass filter with the time constant RESPONSE_TIME."""
    _recent_velocity: Floats = per_robot(np.zeros(2))
    """Measured horizontal velocity after a low-pass filter with the time constant RECENT_TIME, (n, 2), m/s.

    The velocity is in the base frame."""

    def __init__(self, policy: Policy, limits: SafetyLimits | None = None) -> None:
        super().__init__(robot=policy.robot, control_period=policy.control_period)
        self.policy = policy
        self.name = f"safe:{policy.name}"
        self.height_scan = policy.height_scan
        self.observations = policy.observations
        self._limits = limits or SafetyLimits.for_robot(self.robot)
        self._motions: dict[Mode, Motion] = {
            Mode.STOP: Stop(self.robot, self.control_period),
            Mode.DAMP: Damp(self.robot, self.control_period),
        }
        self._brace = Brace(self.robot, self.control_period)
        initialize_state(self, _targets=self.robot.home_pose)

    @property
    def failure(self) -> NDArray[np.object_] | None:
        """Reason of the policy's failure for each robot, (n,), see `ExternalPolicy.failure`.

        The property is None if the policy does not report failures.
        """
        return getattr(self.policy, "failure", None)

    @property
    def mode(self) -> NDArray[np.int8]:
        """Copy of the `Mode` of each robot, (n,)."""
        return self._mode.copy()

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """True for robots in the modes STOP and DAMP, which only a reset ends, (n,)."""
        return np.isin(self._mode, (Mode.STOP, Mode.DAMP))

    def emergency_stop(self, mask: ArrayLike | None = None, *, damp: bool = False) -> None:
        """Stop some robots, from their next action until their next reset.

        Args:
            mask: True for robots to stop, (n,) bool; None stops all robots.
            damp: True: the servos only damp the joints (mode DAMP). False: the trunk sinks slowly (mode STOP).
        """
        self._enter(validate_mask(mask, self.num_envs), Mode.DAMP if damp else Mode.STOP, "emergency stop requested")

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset the safety layer and its policy for a batch of robots.

        An exception that the policy raises here is not caught.

        Args:
            num_envs: Number of robots in the batch.
            seed: Seed for a policy that draws random numbers.
        """
        super().reset(num_envs, seed)
        self.policy.reset(num_envs, seed)

    def _reset_rows(self, mask: Mask) -> None:
        super()._reset_rows(mask)
        self.policy.reset_where(mask)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        rows = observation.astype(np.float64)
        joints = rows[:, OBSERVATION["joint_position"]] + self.robot.home_pose
        self._update_mode(rows)
        targets = self._policy_targets(observation)
        caught = np.flatnonzero(self._mode == Mode.CATCH)
        if len(caught):
            targets[caught] = self._brace.blend(caught, targets[caught], rows[caught])
        for mode, motion in self._motions.items():
            members = np.flatnonzero(self._mode == mode)
            if len(members):
                starting = self._entered & (self._mode == mode)
                motion.start(starting, self._targets[starting])
                targets[members] = motion.targets(members, rows[members], joints[members])
        self._entered[:] = False
        speeds = rows[:, OBSERVATION["joint_velocity"]]
        self._targets = self._limits.limit_targets(
            self.robot, self.control_period, targets, self._targets, joints, speeds
        )
        return to_actions(self.robot, self._targets)

    def _policy_targets(self, observation: NDArray[np.float32]) -> Floats:
        """Return the joint targets of the policy for robots in the modes FOLLOW and CATCH, (n, 12), rad.

        Robots in the modes STOP and DAMP keep their last targets. If the policy raises an exception, all robots in the
        modes FOLLOW and CATCH change to STOP.
        """
        targets = self._targets.copy()
        following = self._mode <= Mode.CATCH
        if following.any():
            try:
                answer = self.policy.act(self._slow_command(observation))
            except Exception as error:
                self._enter(following, Mode.STOP, f"policy raised {format_exception(error)}")
            else:
                self._accept(answer, following, targets)
        return targets

    def _accept(self, answer: object, following: Mask, targets: Floats) -> None:
        """Copy `answer`, the result of the policy, into `targets` for the robots in the mask `following`.

        `targets` are joint targets, (n, 12), rad, which are changed in place. `following` has the shape (n,). Robots
        with invalid values in `answer` change to the mode STOP.
        """
        if not isinstance(answer, np.ndarray) or answer.shape != targets.shape or answer.dtype.kind != "f":
            self._enter(following, Mode.STOP, "policy returned targets of a wrong shape or type")
            return
        finite = np.isfinite(answer).all(axis=1)
        good = following & finite
        targets[good] = answer[good]
        if not finite.all():
            self._enter(following & ~finite, Mode.STOP, "policy returned non-finite targets")

    def _slow_command(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observation with smaller velocity commands for robots in the mode CATCH.

        In this mode, the joint targets are the weighted mean of the brace (low, wide stance) and of the policy. The
        velocity command is multiplied by 1 minus the weight of the brace. If the weight is 1, the policy is therefore
        commanded to stand. The argument and the result have the shape (n, m), with m numbers per robot.
        """
        catching = self._mode == Mode.CATCH
        if not catching.any():
            return observation
        observation = observation.copy()
        scale = (1.0 - self._brace.share[catching]).astype(np.float32)
        observation[catching, OBSERVATION["command"]] *= scale[:, None]
        return observation

    def _update_mode(self, rows: Floats) -> None:
        """Update the mode of each robot from the observation `rows`, (n, m), with m numbers per robot.

        A predicted fall changes FOLLOW to CATCH. CATCH changes back to FOLLOW when the robot is at rest, or when its
        trunk tilts by more than MAX_TILT. STOP changes to DAMP when the trunk tilts by more than MAX_TILT.
        """
        velocity, command = (rows[:, OBSERVATION[name]][:, :2] for name in ("linear_velocity", "command"))
        self._reference = self._reference + (command - self._reference) * (self.control_period / RESPONSE_TIME)
        alarm = velocity_deviation(velocity, self._reference, self._recent_velocity) > FALL_ALARM_DEVIATION
        change = velocity - self._recent_velocity
        self._recent_velocity = self._recent_velocity + change * (self.control_period / RECENT_TIME)
        tilted = -rows[:, OBSERVATION["projected_gravity"]][:, 2] < np.cos(MAX_TILT)
        predicted = (self._mode == Mode.FOLLOW) & alarm & ~tilted
        if predicted.any():
            self._brace.reset_where(predicted)
            self._enter(predicted, Mode.CATCH, "fall predicted")
        catching = self._mode == Mode.CATCH
        if catching.any():
            self._enter(self._brace.advance(catching, alarm, rows), Mode.FOLLOW, "at rest again")
            self._enter(tilted & (self._mode == Mode.CATCH), Mode.FOLLOW, TOO_FAR_OVER)
        self._enter(tilted & (self._mode == Mode.STOP), Mode.DAMP, TOO_FAR_OVER)

    def _enter(self, mask: Mask, mode: Mode, reason: str) -> None:
        """Change the robots for which `mask`, (n,), is True to a mode, and store the reason of the change."""
        self._mode[mask] = mode
        self._entered |= mask
        self.reason[mask] = reason


def velocity_deviation(velocity: Floats, reference: Floats, recent: Floats) -> Floats:
    """Compute the velocity deviation, from which the safety layer predicts falls.

    The deviation is the smaller of two distances: from `velocity` to `reference`, and from `velocity` to `recent`. Each
    distance alone would give false alarms. The distance to `reference` is also large in a gait that does not reach its
    command. The distance to `recent` is also large after a change of the command.

    Args:
        velocity: Measured horizontal velocity, base frame, (n, 2), m/s.
        reference: Horizontal velocity that is expected from the command, base frame, (n, 2), m/s.
        recent: Low-pass filtered measured velocity, base frame, (n, 2), m/s.

    Returns:
        Velocity deviation, (n,), m/s.
    """
    error = velocity - reference
    change = velocity - recent
    squared = np.minimum(error[:, 0] ** 2 + error[:, 1] ** 2, change[:, 0] ** 2 + change[:, 1] ** 2)
    return np.sqrt(squared)
