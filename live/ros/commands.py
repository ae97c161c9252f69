"""Messages that move the robot: joint targets, or velocities for a policy; the refused ones, and their timeout."""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from live.ros.driven import Driven
from live.ros.topics import JOINT_TARGETS, VELOCITY
from live.session import Session
from policies.base import Floats
from quad_env.cli.format import counted
from quad_env.config import COMMAND_BOUND

_STILL = (0.0, 0.0, 0.0)


class Mistake(NamedTuple):
    """Reason to refuse a message."""

    kind: str
    """The same for all messages that are wrong in this way."""
    details: str = ""
    """Of this message."""


class Commands(Protocol):
    """Messages of one topic that the robot follows."""

    topic: str
    timeout: float
    """Simulated s without a valid message after which the robot has to stand."""
    standing: str
    """What `stand` does, in words."""

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """Reason to refuse a message of `size` numbers; where they are too many, `values` need not have them."""

    def follow(self, values: Floats) -> None:
        """Execute a valid message."""

    def stand(self) -> None:
        """Make the robot stand."""


class JointTargets:
    """Joint targets, rad, in the robot's joint order."""

    topic, timeout, standing = JOINT_TARGETS, 0.2, "the robot returns to its standing pose"

    def __init__(self, policy: Driven) -> None:
        self._policy = policy

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """Another count than that of the joints, or a value that is not finite."""
        joints = self._policy.robot.num_joints
        if size != joints:
            return Mistake(f"not {joints} numbers", f" but {size}")
        return None if np.isfinite(values).all() else Mistake("not finite", f": {values.tolist()}")

    def follow(self, values: Floats) -> None:
        """Move the joints to these targets."""
        self._policy.follow(values)

    def stand(self) -> None:
        """Move the joints to the home pose."""
        self._policy.let_go()


class Velocities:
    """Commands of a policy: forward and left, m/s, and yaw rate, rad/s."""

    topic, timeout, standing = VELOCITY, 0.5, "the command is zero"

    def __init__(self, session: Session) -> None:
        self._session = session

    def mistake(self, values: Floats, size: int) -> Mistake | None:
        """A value that is not finite, or out of range of an environment's commands."""
        if not np.isfinite(values).all():
            return Mistake("not finite", f": {values.tolist()}")
        if (np.abs(values) > COMMAND_BOUND).any():
            return Mistake(f"beyond ±{COMMAND_BOUND:g} m/s or rad/s", f": {values.tolist()}")
        return None

    def follow(self, values: Floats) -> None:
        """Steer the policy."""
        self._session.steer(values)

    def stand(self) -> None:
        """Command zero velocity."""
        self._session.steer(_STILL)


class CommandTimeout:
    """Watchdog for messages, in simulated time; before the first message it is off."""

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._latest: float | None = None

    def received(self, now: float) -> bool:
        """Note a message at that time, s; whether it is the first, or the first after a timeout."""
        is_first, self._latest = self._latest is None, now
        return is_first

    def expired(self, now: float) -> bool:
        """Whether the timeout, s, has passed since the latest message; True once."""
        # Rounded, for times are sums of control periods.
        if self._latest is None or round(now - self._latest, 6) <= self._timeout:
            return False
        self._latest = None
        return True


class Refusals:
    """Counts of refused messages by topic and mistake."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, topic: str, mistake: str, details: str = "") -> None:
        """Count a message; only the first of its kind is printed, with the details."""
        self._counts[topic, mistake] += 1
        if self._counts[topic, mistake] == 1:
            self._say(f"{topic}: refused, {mistake}{details}; further ones are counted")

    def count(self, topic: str) -> int:
        """Refused messages of that topic."""
        return sum(count for (name, _), count in self._counts.items() if name == topic)

    def words(self) -> list[str]:
        """`/cmd_vel: 12 messages refused, not finite` for each kind."""
        return [
            f"{topic}: {counted(count, 'message')} refused, {mistake}"
            for (topic, mistake), count in self._counts.items()
        ]
