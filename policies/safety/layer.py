"""A safety layer around any policy: failures end in a controlled stop, falls are caught, limits are kept."""

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
    """Who moves a robot."""

    FOLLOW = 0
    """The policy."""
    CATCH = 1
    """The brace, until the robot is at rest, and back to the policy from there: a fall was predicted."""
    STOP = 2
    """Controlled stop, until a reset."""
    DAMP = 3
    """Joints damped: too far over, or stopped at once by request."""


TOO_FAR_OVER = "too far over"

MAX_TILT = np.deg2rad(65.0)
"""Tilt past which no fall is caught and no stop is under control any more: 5° before the fall rule, `FallRule.tilt`."""
FALL_ALARM_DEVIATION = 0.8866
"""Velocity deviation, m/s, above which a fall is predicted: 0.2 m/s above the largest in an hour of the undisturbed
trot."""
RESPONSE_TIME = 0.25
"""Lag of a walking robot behind its command, s."""
RECENT_TIME = 0.1
"""Time constant of the velocity of late, s: what a robot gains more slowly is no push."""


class Safe(Policy):
    """`policy` as long as it does well; read `mode` and `reason`.

    Args:
        policy: what to guard.
        limits: of every target.
    """

    reason: NDArray[np.object_] = per_robot(np.array("", object))
    """Why each robot came into its mode, (n,) of text; empty at the start."""
    _mode: NDArray[np.int8] = per_robot(np.int8(Mode.FOLLOW))
    _entered: Mask = per_robot(False)
    _targets: Floats = per_robot()
    _reference: Floats = per_robot(np.zeros(2))
    """The planar velocity that a robot following its commands has about now, (n, 2), m/s: the command, lagged."""
    _recent: Floats = per_robot(np.zeros(2))
    """The planar velocity of late, (n, 2), m/s."""

    def __init__(self, policy: Policy, limits: SafetyLimits | None = None) -> None:
        super().__init__(robot=policy.robot, control_period=policy.control_period)
        self.policy = policy
        self.name = f"safe:{policy.name}"
        self.height_scan = policy.height_scan
        self.observations = policy.observations
        self._limits = limits or SafetyLimits.of(self.robot)
        self._motions: dict[Mode, Motion] = {
            Mode.STOP: Stop(self.robot, self.control_period),
            Mode.DAMP: Damp(self.robot, self.control_period),
        }
        self._brace = Brace(self.robot, self.control_period)
        initialize_state(self, _targets=self.robot.home_pose)

    @property
    def failure(self) -> NDArray[np.object_] | None:
        """Why its policy failed each robot, (n,), see `policies.Foreign`; None if it does not report that."""
        return getattr(self.policy, "failure", None)

    @property
    def mode(self) -> NDArray[np.int8]:
        """`Mode` of each robot, (n,), a copy."""
        return self._mode.copy()

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """Which robots it has taken from the policy to stop them, (n,)."""
        return np.isin(self._mode, (Mode.STOP, Mode.DAMP))

    def emergency_stop(self, mask: ArrayLike | None = None, *, damp: bool = False) -> None:
        """Stop those robots, all without a mask, from their next action on until a reset: under control, or damped."""
        self._enter(validate_mask(mask, self.num_envs), Mode.DAMP if damp else Mode.STOP, "emergency stop requested")

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Restart the layer and its policy for `num_envs` robots; exceptions of the policy pass through."""
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
        """Targets (n, 12) of the policy for the robots that follow it; the others keep theirs."""
        targets = self._targets.copy()
        following = self._mode <= Mode.CATCH
        if following.any():
            try:
                answer = self.policy.act(self._slowed(observation))
            except Exception as error:
                self._enter(following, Mode.STOP, f"policy raised {format_exception(error)}")
            else:
                self._accept(answer, following, targets)
        return targets

    def _accept(self, answer: object, following: Mask, targets: Floats) -> None:
        """Put what the policy answered for the following robots into `targets`, if it is good."""
        if not isinstance(answer, np.ndarray) or answer.shape != targets.shape or answer.dtype.kind != "f":
            self._enter(following, Mode.STOP, "policy returned targets of a wrong shape or type")
            return
        finite = np.isfinite(answer).all(axis=1)
        good = following & finite
        targets[good] = answer[good]
        if not finite.all():
            self._enter(following & ~finite, Mode.STOP, "policy returned non-finite targets")

    def _slowed(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observation, the command nearer to zero as far as a robot is braced."""
        catching = self._mode == Mode.CATCH
        if not catching.any():
            return observation
        observation = observation.copy()
        left = (1.0 - self._brace.share[catching]).astype(np.float32)
        observation[catching, OBSERVATION["command"]] *= left[:, None]
        return observation

    def _update_mode(self, rows: Floats) -> None:
        """Catch where a fall is predicted, follow again where it is at rest or past catching."""
        velocity, command = (rows[:, OBSERVATION[name]][:, :2] for name in ("linear_velocity", "command"))
        self._reference = self._reference + (command - self._reference) * (self.control_period / RESPONSE_TIME)
        alarm = velocity_deviation(velocity, self._reference, self._recent) > FALL_ALARM_DEVIATION
        self._recent = self._recent + (velocity - self._recent) * (self.control_period / RECENT_TIME)
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
        self._mode[mask] = mode
        self._entered |= mask
        self.reason[mask] = reason


def velocity_deviation(velocity: Floats, reference: Floats, recent: Floats) -> Floats:
    """Planar speed off both the reference and the velocity of late, m/s, (n, 2) each: the lesser of the two, (n,).

    The first alone would take a gait that does not reach its command for a push, the second alone a change of command.
    """
    off, jump = velocity - reference, velocity - recent
    squared = np.minimum(off[:, 0] ** 2 + off[:, 1] ** 2, jump[:, 0] ** 2 + jump[:, 1] ** 2)
    return np.sqrt(squared)
