"""The state machine: which behaviour each of n robots is in, by the transition table and nothing else."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import CONTROL_PERIOD, Mask, validate_mask
from policies.behaviour.transitions import GUARDS, REQUESTS, TRANSITIONS, State, conditions
from policies.memory import PerRobotState, per_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_SOURCE = np.zeros((len(TRANSITIONS), len(State)), np.bool_)
for _number, _row in enumerate(TRANSITIONS):
    _SOURCE[_number, list(_row.sources)] = True
_TARGET = np.array([row.target for row in TRANSITIONS], np.int8)


class BehaviourMachine(PerRobotState):
    """States of n robots. `request` asks, `observe` looks and lets happen what happens by itself."""

    ticks: NDArray[np.int64] = per_robot(0)
    """Control steps that each robot has been in its state, (n,)."""
    _state: NDArray[np.int8] = per_robot()
    _changed: Mask = per_robot(True)
    _holds: Mask = per_robot(np.zeros(len(GUARDS), np.bool_))

    def __init__(self, start: State = State.STAND, robot: Robot = SIMPLE_QUAD, period: float = CONTROL_PERIOD) -> None:
        self._robot = robot
        self._period = period
        super().__init__(_state=np.int8(start))

    @property
    def state(self) -> NDArray[np.int8]:
        """`State` of each robot, (n,), a copy."""
        return self._state.copy()

    def take_changes(self) -> Mask:
        """Robots that entered a state since this was last asked, (n,)."""
        changed, self._changed = self._changed, np.zeros_like(self._changed)
        return changed

    def request(self, name: str, mask: ArrayLike | None = None) -> Mask:
        """Ask the robots of `mask`, (n,) bool, or all, for a behaviour; the mask of those to which the table does not
        allow it under the conditions of the latest observation. ValueError for a name or mask that does not exist.
        """
        if name not in REQUESTS:
            raise ValueError(f"unknown request {name!r}; valid: {', '.join(REQUESTS)}")
        asked = validate_mask(mask, len(self._state))
        return asked & ~self._take(name, asked)

    def observe(self, observation: NDArray[np.float32]) -> None:
        """One control step: look at the observations (n, k) and let happen what happens by itself."""
        self.ticks += 1
        holds = conditions(self._robot, self._period, observation, self._state, self.ticks)
        self._holds = np.stack([holds[guard] for guard in GUARDS], axis=1)
        self._take("", np.ones(len(self._state), np.bool_))

    def _take(self, request: str, asked: Mask) -> Mask:
        """Let each robot asked take the first row of that request that applies to it; those that took one, (n,)."""
        taken = np.full(len(self._state), -1, np.int64)
        for number, row in reversed([*enumerate(TRANSITIONS)]):
            if row.request != request:
                continue
            applies = asked & _SOURCE[number][self._state]
            if row.guard:
                applies &= self._holds[:, GUARDS.index(row.guard)]
            taken[applies] = number
        moving: Mask = taken >= 0
        self._state[moving] = _TARGET[taken[moving]]
        self.ticks[moving] = 0
        self._changed[moving] = True
        return moving
