"""Policy of behaviours: a state machine selects the behaviour, and a motion or a gait performs it."""

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
"""Largest horizontal speed of a walking robot, m/s; a running robot follows the command without this limit."""
RUN_ABOVE = 0.7
"""Commanded speed above which a walking robot starts to run if `follow` is True, m/s."""
WALK_BELOW = 0.5
"""Commanded speed below which a running robot walks again if `follow` is True, m/s."""
MOVE_ABOVE = 0.02
"""Command component above which a standing robot walks if `follow` is True, m/s or rad/s; below, it stands."""
BLEND_TIME = 0.2
"""Duration of the blend from the targets of the last behaviour to the targets of the gait, s."""

_COMMAND = OBSERVATION["command"]


class Behaviour(Policy):
    """Policy with behaviours: each robot is in one `State`, which `state` returns and `request` changes.

    Args:
        start: State after a reset.
        follow: True to request stand, walk and run automatically from the commanded velocity. If False, call `request`.
        **kwargs: See `Policy`.
    """

    name = "behaviour"
    stiff_servos = True
    _targets: Floats = per_robot()
    _was_moving: Mask = per_robot(False)

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
        """`State` of each robot, (n,)."""
        return self.machine.state

    def request(self, name: str, mask: ArrayLike | None = None) -> Mask:
        """Request the behaviour `name` of the robots in the `mask`; see `BehaviourMachine.request`."""
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
                    # The motion starts from the last targets, so that the change of behaviour is smooth.
                    motion.start(entering, self._targets[entering])
                members = np.flatnonzero(within)
                targets[members] = motion.targets(members, rows[members], joints[members])
        self._targets = targets
        return to_actions(self.robot, targets)

    def _gait_targets(self, observation: NDArray[np.float32], state: NDArray[np.int8]) -> Floats:
        """Return the targets, (n, 12), rad: blended gait targets in walk and run, else the last targets."""
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
        """Request stand, walk or run from the commanded velocity."""
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
    """Limit the horizontal velocity of commands, (n, 3), to WALKING_SPEED."""
    speed = np.sqrt(command[:, 0] ** 2 + command[:, 1] ** 2)
    share = np.minimum(1.0, np.float32(WALKING_SPEED) / np.maximum(speed, np.float32(1e-6)))
    return np.concatenate((command[:, :2] * share[:, None], command[:, 2:]), axis=1)
