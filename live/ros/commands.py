"""What moves the robot from outside: joint targets, or velocities for a policy."""

from typing import NamedTuple, Protocol

import numpy as np

from live.ros.driven import Driven
from live.ros.topics import JOINT_TARGETS, VELOCITY
from live.session import Session
from policies.base import Floats
from quad_env.config import COMMAND_BOUND

_STILL = (0.0, 0.0, 0.0)


class Mistake(NamedTuple):
    """Why a message is refused."""

    kind: str
    """The same for all messages that are wrong in this way."""
    details: str = ""
    """Of this message."""


class Commands(Protocol):
    """Messages of one topic that the robot follows."""

    topic: str
    patience: float
    """Simulated s without a good message after which the robot is made to stand."""
    standing: str
    """What `stand` does, in words."""

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """Why a message is refused; of `size` numbers, which `values` need not have if they are too many."""

    def follow(self, values: Floats) -> None:
        """Do what a good message says."""

    def stand(self) -> None:
        """Do what is done without messages."""


class JointTargets:
    """Joint targets, rad, in the robot's joint order."""

    topic, patience, standing = JOINT_TARGETS, 0.2, "the robot returns to its standing pose"

    def __init__(self, policy: Driven) -> None:
        self._policy = policy

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """Another count than that of the joints, or a value that is none."""
        joints = self._policy.robot.num_joints
        if size != joints:
            return Mistake(f"not {joints} numbers", f" but {size}")
        return None if np.isfinite(values).all() else Mistake("not finite", f": {values.tolist()}")

    def follow(self, values: Floats) -> None:
        """Have the joints follow."""
        self._policy.follow(values)

    def stand(self) -> None:
        """Let the joints go home."""
        self._policy.let_go()


class Velocities:
    """Commands of a policy: forward and left, m/s, and yaw rate, rad/s."""

    topic, patience, standing = VELOCITY, 0.5, "the command is zero"

    def __init__(self, session: Session) -> None:
        self._session = session

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """A value that is none, or beyond what an environment takes for a command."""
        if not np.isfinite(values).all():
            return Mistake("not finite", f": {values.tolist()}")
        if (np.abs(values) > COMMAND_BOUND).any():
            return Mistake(f"beyond ±{COMMAND_BOUND:g} m/s or rad/s", f": {values.tolist()}")
        return None

    def follow(self, values: Floats) -> None:
        """Steer the policy."""
        self._session.steer(values)

    def stand(self) -> None:
        """Command it to stand still."""
        self._session.steer(_STILL)
