"""Safety layer for any policy: controlled stop after failures, brace before falls, limits of targets."""

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
    """Source of the joint targets of a robot."""

    FOLLOW = 0
    """The policy gives the targets."""
    CATCH = 1
    """The brace gives the targets after a predicted fall, until the robot is at rest."""
    STOP = 2
    """A controlled stop gives the targets, until a reset."""
    DAMP = 3
    """The joints are damped, because the robot tilts too far or an emergency stop has requested it."""


TOO_FAR_OVER = "too far over"
"""Reason of a change of mode because of a tilt above MAX_TILT."""

MAX_TILT = np.deg2rad(65.0)
"""Tilt above which neither the brace nor a controlled stop works, rad; 5° less than the fall rule, `FallRule.tilt`."""
FALL_ALARM_DEVIATION = 0.8866
"""Velocity deviation above which a fall is predicted, m/s.

The value is 0.2 m/s more than the largest deviation in one hour of the undisturbed trot."""
RESPONSE_TIME = 0.25
"""Time constant of the velocity that a walking robot is expected to have after a new command, s."""
RECENT_TIME = 0.1
"""Time constant of the filter of the recent velocity, s. A change of velocity that is slower is not a push."""


class Safe(Policy):
    """Policy within the safety layer; `mode` and `reason` show the state of the layer.

    Args:
        policy: Policy inside the safety layer.
        limits: Limits of all targets; by default the limits of the robot with ideal actuators.
    """

    reason: NDArray[np.object_] = per_robot(np.array("", object))
    """Reason of the last change of mode of each robot, text, (n,); empty after a reset."""
    _mode: NDArray[np.int8] = per_robot(np.int8(Mode.FOLLOW))
    _entered: Mask = per_robot(False)
    _targets: Floats = per_robot()
    _reference: Floats = per_robot(np.zeros(2))
    """Expected horizontal velocity: the command, low-pass filtered with RESPONSE_TIME, (n, 2), m/s."""
    _recent_velocity: Floats = per_robot(np.zeros(2))
    """Measured horizontal velocity, low-pass filtered with RECENT_TIME, (n, 2), m/s."""

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
        """Reason of each robot's failure inside the policy, (n,), see `ExternalPolicy`; None if not reported."""
        return getattr(self.policy, "failure", None)

    @property
    def mode(self) -> NDArray[np.int8]:
        """Copy of the `Mode` of each robot, (n,)."""
        return self._mode.copy()

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """True for robots that the layer has stopped, (n,)."""
        return np.isin(self._mode, (Mode.STOP, Mode.DAMP))

    def emergency_stop(self, mask: ArrayLike | None = None, *, damp: bool = False) -> None:
        """Stop some robots from their next action on, until a reset.

        Args:
            mask: Robots to stop, (n,) bool; all by default.
            damp: True to damp the joints at once; False for a controlled stop.
        """
        self._enter(validate_mask(mask, self.num_envs), Mode.DAMP if damp else Mode.STOP, "emergency stop requested")

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset layer and policy for `num_envs` robots with a `seed`. Exceptions of the policy are not caught."""
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
        """Return the targets of the policy, (n, 12), rad; the last targets for robots in other modes."""
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
        """Copy `answer`, the targets of the policy, into `targets` for the robots in the mask `following`.

        Robots with invalid targets are stopped.
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
        """Return the observation with the commands of braced robots scaled down."""
        catching = self._mode == Mode.CATCH
        if not catching.any():
            return observation
        observation = observation.copy()
        scale = (1.0 - self._brace.share[catching]).astype(np.float32)
        observation[catching, OBSERVATION["command"]] *= scale[:, None]
        return observation

    def _update_mode(self, rows: Floats) -> None:
        """Update the mode: CATCH after a predicted fall, FOLLOW after rest or a tilt that is too large."""
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
        """Set mode and reason of the robots in the mask."""
        self._mode[mask] = mode
        self._entered |= mask
        self.reason[mask] = reason


def velocity_deviation(velocity: Floats, reference: Floats, recent: Floats) -> Floats:
    """Compute the smaller of two distances: velocity to reference, and velocity to recent velocity.

    Each distance alone would give false alarms. The distance from the reference is also large in a gait that does not
    reach its command. The distance from the recent velocity is also large after a change of the command.

    Args:
        velocity: Measured horizontal velocity, (n, 2), m/s.
        reference: Expected horizontal velocity, (n, 2), m/s.
        recent: Recent horizontal velocity, (n, 2), m/s.

    Returns:
        Smaller distance, (n,), m/s.
    """
    error = velocity - reference
    change = velocity - recent
    squared = np.minimum(error[:, 0] ** 2 + error[:, 1] ** 2, change[:, 0] ** 2 + change[:, 1] ** 2)
    return np.sqrt(squared)
