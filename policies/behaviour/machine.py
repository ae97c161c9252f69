"""State machine of the behaviours (stand, walk, run, jump, fall, recover) of n robots.

The table `policies.behaviour.transitions.TRANSITIONS` defines all transitions between these behaviours.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import CONTROL_PERIOD, Mask, validate_mask
from policies.behaviour.transitions import GUARDS, REQUESTS, TRANSITIONS, State, conditions
from policies.memory import PerRobotState, per_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_SOURCE = np.zeros((len(TRANSITIONS), len(State)), np.bool_)
"""True if a transition (row of `TRANSITIONS`) can start in a `State`, (transitions, states) bool."""
for _number, _transition in enumerate(TRANSITIONS):
    _SOURCE[_number, list(_transition.sources)] = True
_TARGET = np.array([transition.target for transition in TRANSITIONS], np.int8)
"""For each transition (row of `TRANSITIONS`): number of the `State` that it leads to, (transitions,)."""


class BehaviourMachine(PerRobotState):
    """State machine that selects the behaviour of n robots; the current behaviour of a robot is its `State`.

    The method `request` performs transitions that a caller asks for, for example to a jump. The method `observe`
    performs transitions that follow from the observation, for example to a fall. The policy `Behaviour` uses one object
    of this class.

    Args:
        start: State of each robot after a reset.
        robot: Robot with the home pose and the link lengths.
        period: Time between two calls of `observe`, s.
    """

    ticks: NDArray[np.int64] = per_robot(0)
    """Number of control steps since each robot entered its current state, (n,)."""
    _state: NDArray[np.int8] = per_robot()
    """Number of the current `State` of each robot, (n,)."""
    _changed: Mask = per_robot(True)
    """True for robots that have entered a state since the last call of `take_changes`, (n,)."""
    _holds: Mask = per_robot(np.zeros(len(GUARDS), np.bool_))
    """True for conditions that hold in the latest observation, (n, len(GUARDS)); columns as in `GUARDS`."""

    def __init__(self, start: State = State.STAND, robot: Robot = SIMPLE_QUAD, period: float = CONTROL_PERIOD) -> None:
        self._robot = robot
        self._period = period
        super().__init__(_state=np.int8(start))

    @property
    def state(self) -> NDArray[np.int8]:
        """Copy of the current `State` of each robot, as a number, (n,)."""
        return self._state.copy()

    def take_changes(self) -> Mask:
        """Return True for robots that have entered a new state since the last call of this method, (n,)."""
        changed = self._changed
        self._changed = np.zeros_like(changed)
        return changed

    def request(self, name: str, mask: ArrayLike | None = None) -> Mask:
        """Request a change of behaviour from some robots.

        Args:
            name: Name of the requested behaviour, one of `REQUESTS`, for example `jump`.
            mask: True for robots that get the request, (n,) bool; None for all robots.

        Returns:
            True for robots that refuse the request, (n,). A robot refuses if `TRANSITIONS` has no row with this request
            and its current state, or if the condition of the row does not hold in its latest observation.

        Raises:
            ValueError: The name is not one of `REQUESTS`.
        """
        if name not in REQUESTS:
            raise ValueError(f"unknown request {name!r}; valid: {', '.join(REQUESTS)}")
        asked = validate_mask(mask, len(self._state))
        return asked & ~self._take(name, asked)

    def observe(self, observation: NDArray[np.float32]) -> None:
        """Count one control step, and perform the transitions that need no request.

        The conditions of the transitions are evaluated from the `observation` of all robots, (n, k), with k numbers per
        robot.
        """
        self.ticks += 1
        holds = conditions(self._robot, self._period, observation, self._state, self.ticks)
        self._holds = np.stack([holds[guard] for guard in GUARDS], axis=1)
        self._take("", np.ones(len(self._state), np.bool_))

    def _take(self, request: str, asked: Mask) -> Mask:
        """Perform the first applicable transition for the robots for which `asked`, (n,), is True.

        A row of `TRANSITIONS` applies if the robot is in one of its source states, its request is `request`, and its
        condition holds. An empty `request` selects the transitions that need no request. Returns True for robots that
        have changed their state, (n,).
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
