"""The robot's side of the ROS interface, without ROS: messages in as numbers, readings out, control step by step."""

from collections.abc import Callable, Sequence

import numpy as np

from live.ros.commands import Commands, CommandTimeout, JointTargets, Mistake, Refusals, Velocities
from live.ros.driven import Driven
from live.ros.link import Packet
from live.ros.readings import FallWatch, Readings
from live.ros.topics import RESET
from live.session import Session


class Bridge:
    """One robot of a session, driven by messages: by joint targets if `Driven` moves it, else by velocities.

    The simulation goes on in any case: invalid messages are refused, and without valid ones the robot stands.

    Args:
        session: of one robot; its commands are the bridge's from now on.
        say: called with lines for the terminal.
    """

    def __init__(self, session: Session, say: Callable[[str], None]) -> None:
        self._session, self._say = session, say
        (policy,) = session.policies
        self._commands: Commands = JointTargets(policy) if isinstance(policy, Driven) else Velocities(session)
        self._timeout = CommandTimeout(self._commands.timeout)
        self.refusals = Refusals(say)
        self._refused_before = 0
        self._readings, self._falls = Readings(session.env.dt), FallWatch(session.env.dt)
        self._steps, self._period = 0, round(session.env.dt * 1e9)
        session.steer((0.0, 0.0, 0.0))
        session.reset(session.seed)

    @property
    def time(self) -> float:
        """Simulated s since the beginning; no reset turns it back."""
        return self._steps * self._period * 1e-9

    def take(self, topic: str, values: Sequence[float], size: int) -> None:
        """A message of that topic with `size` numbers; of one that is too long, `values` need not have them."""
        if topic == RESET:
            self._session.reset()
            return
        numbers, commands = np.asarray(values, np.float64), self._commands
        is_followed = topic == commands.topic
        mistake = commands.mistake(numbers, size) if is_followed else Mistake(f"{commands.topic} moves this robot")
        if mistake is not None:
            self.refusals.note(topic, *mistake)
            return
        commands.follow(numbers)
        if self._timeout.received(self.time):
            self._say(f"{topic} is followed")
        self._refused_before = self.refusals.count(topic)

    def step(self) -> Packet:
        """Packet of the robot after a further control step."""
        if self._timeout.expired(self.time):
            self._stand()
        step = self._session.step()
        self._steps += 1
        packet = self._readings.of_step(step, self._steps, self._steps * self._period)
        if news := self._falls(step):
            self._say(news)
        if step.infos["diverged"][0]:
            self._say("the simulation has diverged; the robot is reset")
            self._session.reset()
        return packet

    def _stand(self) -> None:
        commands = self._commands
        commands.stand()
        refused = self.refusals.count(commands.topic) - self._refused_before
        meanwhile = f" ({refused} refused meanwhile)" if refused else ""
        timeout = f"nothing good on {commands.topic} for {commands.timeout:g} s{meanwhile}"
        self._say(f"{timeout}: {commands.standing} until the next")
