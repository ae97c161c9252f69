"""Policy with several behaviours: stand, walk, run, jump, fall and recover.

A state machine selects the behaviour of each robot. A sequence of joint targets performs the behaviour; to walk and
run, these targets come from a trot.
"""

from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Actions, Floats, Mask, Policy, PolicyKwargs, to_actions
from policies.behaviour.machine import BehaviourMachine
from policies.behaviour.motion import Damp, Motion, make_hold, make_jump
from policies.behaviour.recovery import Recovery
from policies.behaviour.transitions import State
from policies.memory import initialize_state, per_robot
from policies.trot.open_loop import Trot
from quad_env import OBSERVATION

WALKING_SPEED = 0.6
"""Limit of the commanded horizontal speed in the behaviour `State.WALK`, m/s.

In the behaviour `State.RUN`, the command is not limited."""
RUN_ABOVE = 0.7
"""Commanded horizontal speed above which a walking robot starts to run, m/s.

This change happens only if `Behaviour(follow=True)`."""
WALK_BELOW = 0.5
"""Commanded horizontal speed below which a running robot walks again, m/s.

This change happens only if `Behaviour(follow=True)`."""
MOVE_ABOVE = 0.02
"""Absolute command component above which a standing robot starts to walk, m/s or rad/s.

A walking robot stands again if no command component is above this limit. These changes happen only if
`Behaviour(follow=True)`."""
BLEND_TIME = 0.2
"""Duration of the blend from the last joint targets to the targets of the trot when a robot starts to walk, s."""

_COMMAND = OBSERVATION["command"]


class Behaviour(Policy):
    """Policy with several behaviours, for example walk, jump and recover.

    Each robot has one behaviour at a time, its `State`. The property `state` returns the current behaviour of all
    robots, and the method `request` changes it.

    Args:
        start: State of each robot after a reset.
        follow: True: change between stand, walk and run automatically, from the commanded velocity. False: only
            `request` causes these changes.
        **kwargs: Keyword arguments `robot` and `control_period` of `Policy`.
    """

    name = "behaviour"
    stiff_servos = True
    _targets: Floats = per_robot()
    """Joint targets of the last action, (n, 12), rad; the home pose after a reset."""
    _was_moving: Mask = per_robot(False)
    """True for robots that walked or ran in the last control step, (n,)."""

    def __init__(self, start: State = State.STAND, follow: bool = True, **kwargs: Unpack[PolicyKwargs]) -> None:
        super().__init__(**kwargs)
        robot = self.robot
        control_period = self.control_period
        self._gait = Trot(robot=robot, control_period=control_period)
        self._follow = follow
        self.machine = BehaviourMachine(start, robot, control_period)
        self._motions: dict[State, Motion] = {
            State.FALL: Damp(robot, control_period),
            State.STAND: make_hold(robot, control_period),
            State.RECOVER: Recovery(robot, control_period),
            State.JUMP: make_jump(robot, control_period),
        }
        initialize_state(self, _targets=robot.home_pose)

    @property
    def state(self) -> NDArray[np.int8]:
        """Current `State` of each robot, as a number, (n,)."""
        return self.machine.state

    def request(self, name: str, mask: ArrayLike | None = None) -> Mask:
        """Request a change of behaviour from some robots.

        Args:
            name: Name of the requested behaviour, one of `REQUESTS`, for example `jump`.
            mask: True for robots that get the request, (n,) bool; None for all robots.

        Returns:
            True for robots that refuse the request, (n,), see `BehaviourMachine.request`.
        """
        return self.machine.request(name, mask)

    def _allocate(self, num_envs: int) -> None:
        super()._allocate(num_envs)
        self._gait.reset(num_envs)

    def _reset_rows(self, mask: Mask) -> None:
        super()._reset_rows(mask)
        self._gait.reset_where(mask)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self.machine.observe(observation)
        if self._follow:
            self._request_from_command(observation)
        state = self.machine.state
        changed = self.machine.take_changes()
        rows = observation.astype(np.float64)
        joints = rows[:, OBSERVATION["joint_position"]] + self.robot.home_pose
        targets = self._gait_targets(observation, state)
        for behaviour, motion in self._motions.items():
            within = state == behaviour
            if within.any():
                if (entering := within & changed).any():
                    # The motion starts from the last joint targets, so that the joint targets do not jump.
                    motion.start(entering, self._targets[entering])
                members = np.flatnonzero(within)
                targets[members] = motion.targets(members, rows[members], joints[members])
        self._targets = targets
        return to_actions(self.robot, targets)

    def _gait_targets(self, observation: NDArray[np.float32], state: NDArray[np.int8]) -> Floats:
        """Return the joint targets of the trot for robots that walk or run, (n, 12), rad.

        Robots in other behaviours keep their last joint targets. When a robot starts to walk, its last targets are
        blended with the targets of the trot. `state` is the `State` of each robot, (n,).
        """
        moving = (state == State.WALK) | (state == State.RUN)
        starting = moving & ~self._was_moving
        self._was_moving = moving
        if not moving.any():
            return self._targets.copy()
        if starting.any():
            self._gait.reset_where(starting)
        asked = observation.copy()
        asked[:, _COMMAND] = np.where(
            (state == State.WALK)[:, None], limit_to_walking_speed(asked[:, _COMMAND]), asked[:, _COMMAND]
        )
        gait = self._gait.act(asked).astype(np.float64)
        share = np.minimum((self.machine.ticks + 1) / round(BLEND_TIME / self.control_period), 1.0)
        blended = self._targets + (gait - self._targets) * np.where(state == State.WALK, share, 1.0)[:, None]
        return np.where(moving[:, None], blended, self._targets)

    def _request_from_command(self, observation: NDArray[np.float32]) -> None:
        """Request the behaviours stand, walk and run according to the commanded velocity of each robot."""
        command = observation[:, _COMMAND].astype(np.float64)
        state = self.machine.state
        speed = np.sqrt(command[:, 0] ** 2 + command[:, 1] ** 2)
        moving = (np.abs(command) > MOVE_ABOVE).any(axis=1)
        wanted = {
            "walk": ((state == State.STAND) & moving) | ((state == State.RUN) & (speed < WALK_BELOW)),
            "stand": (state == State.WALK) & ~moving,
            "run": (state == State.WALK) & (speed > RUN_ABOVE),
        }
        for name, mask in wanted.items():
            if mask.any():
                self.machine.request(name, mask)


def limit_to_walking_speed(command: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return velocity commands with a horizontal speed of at most `WALKING_SPEED`.

    The direction of motion and the yaw rate of a `command` do not change. The argument and the result have the columns
    forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s, (n, 3).
    """
    speed = np.sqrt(command[:, 0] ** 2 + command[:, 1] ** 2)
    share = np.minimum(1.0, np.float32(WALKING_SPEED) / np.maximum(speed, np.float32(1e-6)))
    return np.concatenate((command[:, :2] * share[:, None], command[:, 2:]), axis=1)
