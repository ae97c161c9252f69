"""State machine of the behaviours; the transition table defines all its transitions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import CONTROL_PERIOD, Mask, validate_mask
from policies.behaviour.transitions import GUARDS, REQUESTS, TRANSITIONS, State, conditions
from policies.memory import PerRobotState, per_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_SOURCE = np.zeros((len(TRANSITIONS), len(State)), np.bool_)
"""Mask (transitions, states): True if the transition can start from the state."""
for _number, _transition in enumerate(TRANSITIONS):
    _SOURCE[_number, list(_transition.sources)] = True
_TARGET = np.array([transition.target for transition in TRANSITIONS], np.int8)
"""State after each transition, (transitions,)."""


class BehaviourMachine(PerRobotState):
    """States of n robots, changed by `request` and `observe`.

    `request` triggers transitions on demand. `observe` triggers the transitions that need no request. The policy
    `Behaviour` uses one object of this class.

    Args:
        start: State after a reset.
        robot: Robot.
        period: Time between two calls of `observe`, s.
    """

    ticks: NDArray[np.int64] = per_robot(0)
    """Control steps since each robot entered its state, (n,)."""
    _state: NDArray[np.int8] = per_robot()
    _changed: Mask = per_robot(True)
    _holds: Mask = per_robot(np.zeros(len(GUARDS), np.bool_))

    def __init__(self, start: State = State.STAND, robot: Robot = SIMPLE_QUAD, period: float = CONTROL_PERIOD) -> None:
        self._robot = robot
        self._period = period
        super().__init__(_state=np.int8(start))

    @property
    def state(self) -> NDArray[np.int8]:
        """Copy of the `State` of each robot, (n,)."""
        return self._state.copy()

    def take_changes(self) -> Mask:
        """Return True for robots that have entered a state since the last call of this method, (n,)."""
        changed = self._changed
        self._changed = np.zeros_like(changed)
        return changed

    def request(self, name: str, mask: ArrayLike | None = None) -> Mask:
        """Ask some robots for a behaviour.

        Args:
            name: One of REQUESTS.
            mask: Robots, (n,) bool; all by default.

        Returns:
            True for robots that refuse the request, (n,), because the transition table does not allow it under the
            conditions of the latest observation.

        Raises:
            ValueError: The name is unknown.
        """
        if name not in REQUESTS:
            raise ValueError(f"unknown request {name!r}; valid: {', '.join(REQUESTS)}")
        asked = validate_mask(mask, len(self._state))
        return asked & ~self._take(name, asked)

    def observe(self, observation: NDArray[np.float32]) -> None:
        """Count a control step, and take the transitions that an `observation`, (n, k), triggers by itself."""
        self.ticks += 1
        holds = conditions(self._robot, self._period, observation, self._state, self.ticks)
        self._holds = np.stack([holds[guard] for guard in GUARDS], axis=1)
        self._take("", np.ones(len(self._state), np.bool_))

    def _take(self, request: str, asked: Mask) -> Mask:
        """Take the first transition of each robot in the mask `asked` that applies to a `request`.

        Returns True for the robots that took a transition, (n,).
        """
        taken = np.full(len(self._state), -1, np.int64)
        for number, transition in reversed([*enumerate(TRANSITIONS)]):
            if transition.request != request:
                continue
            applies = asked & _SOURCE[number][self._state]
            if transition.guard:
                applies &= self._holds[:, GUARDS.index(transition.guard)]
            taken[applies] = number
        moving: Mask = taken >= 0
        self._state[moving] = _TARGET[taken[moving]]
        self.ticks[moving] = 0
        self._changed[moving] = True
        return moving
