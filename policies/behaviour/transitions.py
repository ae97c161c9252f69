"""The behaviours and every way from one to another, as data: the machine, the tests and the diagram read this table."""

from dataclasses import dataclass
from enum import IntEnum


class State(IntEnum):
    """What a robot is doing; it does exactly one of these at a time."""

    PASSIVE = 0
    """Joints damped."""
    STAND_UP = 1
    STAND = 2
    WALK = 3
    RUN = 4
    JUMP = 5
    FALL = 6
    """Joints damped until the tumbling is over."""
    RECOVER = 7
    """Turning over and getting up."""
    EMERGENCY_STOP = 8
    """Joints damped; left by request alone."""

    @property
    def label(self) -> str:
        """Name of the state in messages and requests: `stand_up`."""
        return self.name.lower()


@dataclass(frozen=True)
class Transition:
    """One row; of the rows that apply at once the first is taken."""

    sources: tuple[State, ...]
    request: str
    """The request that it answers; empty for one that happens by itself."""
    guard: str
    """Condition of `policies.behaviour.guards` that must hold; empty for none."""
    target: State
    reason: str
    """What the log says."""


ALL = tuple(State)
ON_ITS_LEGS = (State.STAND, State.WALK, State.RUN, State.JUMP)
GETTING_UP = (State.STAND_UP, State.RECOVER)

TRANSITIONS = (
    Transition(ALL, "emergency_stop", "", State.EMERGENCY_STOP, "emergency stop requested"),
    Transition((State.EMERGENCY_STOP,), "passive", "still", State.PASSIVE, "emergency stop released"),
    Transition((State.STAND, State.FALL, *GETTING_UP), "passive", "", State.PASSIVE, "rest requested"),
    Transition((State.PASSIVE,), "stand", "upright", State.STAND_UP, "stand requested"),
    Transition((State.PASSIVE,), "stand", "tilted", State.RECOVER, "stand requested, lying on side or back"),
    Transition((State.WALK,), "stand", "", State.STAND, "stand requested"),
    Transition((State.STAND, State.RUN), "walk", "", State.WALK, "walk requested"),
    Transition((State.WALK,), "run", "", State.RUN, "run requested"),
    Transition((State.STAND,), "jump", "in home pose", State.JUMP, "jump requested"),
    Transition(ON_ITS_LEGS, "", "toppling", State.FALL, "fell"),
    Transition((State.JUMP,), "", "landed", State.STAND, "landed"),
    Transition((State.JUMP,), "", "late", State.FALL, "did not land standing in time"),
    Transition((State.FALL,), "", "settled", State.RECOVER, "fall is over"),
    Transition((State.FALL,), "", "late", State.RECOVER, "waited long enough for the fall to end"),
    Transition(GETTING_UP, "", "in home pose", State.STAND, "stands"),
    Transition(GETTING_UP, "", "late", State.FALL, "did not stand up in time"),
)

REQUESTS = tuple(dict.fromkeys(row.request for row in TRANSITIONS if row.request))
"""What may be asked for."""
GUARDS = tuple(dict.fromkeys(row.guard for row in TRANSITIONS if row.guard))
"""Conditions that the table looks at."""

TIME_LIMIT: dict[State, float] = {State.STAND_UP: 6.0, State.JUMP: 3.0, State.FALL: 0.5, State.RECOVER: 8.0}
"""s in a state after which it is `late`; in the others it never is."""


def valid_requests(state: State) -> tuple[str, ...]:
    """What may be asked of a robot in that state, conditions aside."""
    return tuple(
        request for request in REQUESTS if any(state in row.sources for row in TRANSITIONS if row.request == request)
    )
