"""Check of received motor commands: a robot follows only valid commands of one writer, and is damped otherwise."""

from collections import Counter, deque
from collections.abc import Callable, Sequence

import numpy as np

from live.unitree.checksum import checksum, is_intact
from live.unitree.messages import Received, UnitreeMessage
from live.unitree.motors import MotorCommands, damped, read_commands

COMMAND_TIMEOUT = 0.2
"""Time after the last valid command at which the motors are damped, simulated time, s."""
WRITER_TIMEOUT = 0.5
"""Time after the last message of a writer at which it no longer counts as a second writer, simulated time, s."""
MAX_RATE = 4000.0
"""Largest rate of commands that is followed, messages per second of wall time."""
RATE_WINDOW = 0.2
"""Wall time over which the rate of commands is counted, s; a delayed process receives many messages at once."""
REPORT_PERIOD = 5.0
"""Simulated time within which a fault of one kind is reported only once, s."""
CHECKED_MESSAGES = 8
"""Number of the newest messages of one step that are checked; older ones are already out of date."""


class CommandGuard:
    """Chooses the motor commands that a robot follows from the messages that arrive on `rt/lowcmd`.

    A message with a wrong checksum, with numbers that are not finite or with negative gains damps the motors until the
    next valid message. The motors are also damped while two writers send, while messages flood in, and after the
    commands have stopped.

    Args:
        log: Function that prints a line of text.
    """

    def __init__(self, log: Callable[[str], None]) -> None:
        self._log = log
        self.commands = damped()
        """Motor commands to follow, in the order of the motors."""
        self.is_following = False
        """True if `commands` come from a valid message."""
        self.has_followed = False
        """True if a valid message was ever followed."""
        self.faults: Counter[str] = Counter()
        """Kind of a fault -> number of refused messages, and of interruptions."""
        self._reported: dict[str, float] = {}
        self._command_time = 0.0
        self._writers: dict[int, float] = {}
        self._arrivals: deque[tuple[float, int]] = deque()

    def update(self, messages: Sequence[Received], time: float, wall_time: float) -> None:
        """Take the messages of one simulation step into account.

        Args:
            messages: Messages that have arrived since the last step, oldest first.
            time: Simulated time, s.
            wall_time: Time of a clock of the machine, s.
        """
        for message in messages:
            self._writers[message.writer] = time
        self._writers = {writer: last for writer, last in self._writers.items() if time - last < WRITER_TIMEOUT}
        if self._is_flooded(len(messages), wall_time):
            self._damp("flood", f"over {MAX_RATE:g} messages per second", time, len(messages))
            return
        if len(self._writers) > 1:
            if messages:
                self._damp("two writers", f"{len(self._writers)} writers at once", time, len(messages))
            return
        for message in messages[-CHECKED_MESSAGES:]:
            self._check(message.data, time)
        if self.is_following and time - self._command_time > COMMAND_TIMEOUT:
            self._damp("stale", f"no valid command for {COMMAND_TIMEOUT:g} s", time)

    def _is_flooded(self, count: int, wall_time: float) -> bool:
        """Return True if messages arrive too fast; `count` messages have arrived since the last step."""
        self._arrivals.append((wall_time, count))
        while wall_time - self._arrivals[0][0] > RATE_WINDOW:
            self._arrivals.popleft()
        elapsed = max(RATE_WINDOW, wall_time - self._arrivals[0][0])
        return sum(number for _, number in self._arrivals) > MAX_RATE * elapsed

    def _check(self, data: bytes, time: float) -> None:
        """Follow the message `data` if it is valid, otherwise damp the motors."""
        try:
            message = UnitreeMessage("LowCmd_", data)
        except ValueError as error:
            self._damp("unreadable", str(error), time)
            return
        if not is_intact(message):
            fact = f"wrong CRC, got {message.get('crc')[0]:#010x}; valid: {checksum(message):#010x}"
            self._damp("wrong CRC", fact, time)
            return
        commands = read_commands(message)
        if not all(np.isfinite(values).all() for values in commands):
            self._damp("not finite", "a number is NaN or infinite", time)
            return
        if (commands.kp < 0.0).any() or (commands.kd < 0.0).any():
            self._damp("negative gain", f"negative gain, got {min(*commands.kp, *commands.kd):g}; valid: from 0", time)
            return
        self._follow(commands, time)

    def _follow(self, commands: MotorCommands, time: float) -> None:
        """Follow valid motor commands from the simulated time `time`, s, on."""
        if not self.is_following:
            self._report("followed", "followed", time)
        self.commands = commands
        self.is_following = True
        self.has_followed = True
        self._command_time = time

    def _damp(self, kind: str, fact: str, time: float, count: int = 1) -> None:
        """Damp the motors after a fault.

        Args:
            kind: Kind of the fault.
            fact: Description of the fault.
            time: Simulated time, s.
            count: Number of refused messages.
        """
        self.faults[kind] += count
        self.is_following = False
        self.commands = damped()
        self._report(kind, f"{fact}; the motors are damped until the next valid command", time)

    def _report(self, kind: str, text: str, time: float) -> None:
        """Print a line, unless a line of the same kind was printed less than `REPORT_PERIOD` ago."""
        if time - self._reported.get(kind, -np.inf) < REPORT_PERIOD:
            return
        self._reported[kind] = time
        self._log(f"rt/lowcmd: {text}")
