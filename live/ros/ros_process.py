"""The process that speaks ROS, seen from the one that simulates: packets of numbers over a socket between the two."""

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from live.ros.node import MAX_PACKET_SIZE
from quad_env.cli.command_line import UsageError

START_TIMEOUT = 30.0
"""For the process to be a node, s."""
MAX_PACKETS_PER_STEP = 500
"""Packets that are read in one go; a faster sender waits."""
EXIT_TIMEOUT = 2.0
"""For the process to sign off from its master, s."""

Packet = dict[str, Any]


class LinkLost(UsageError):
    """The process that speaks ROS has ended; the message says why, if that is known."""


class RosProcess:
    """Starts that process and talks with it: neither side ever waits for the other to simulate or to publish."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        if sys.platform != "linux":
            raise LinkLost("the ROS node runs on Linux alone: in a container or a virtual machine elsewhere")
        # Packets arrive whole or not at all, and no other process can connect: it has no address.
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            # In a session of its own, Ctrl-C does not reach it: the simulation ends it.
            self._process = subprocess.Popen(
                command, stdin=theirs.fileno(), env=dict(environment), start_new_session=True
            )
        self._socket.settimeout(START_TIMEOUT)

    def wait_until_ready(self) -> str:
        """Where it has become a node: the words of the process. Raises LinkLost."""
        try:
            packet = self._read()
        except TimeoutError:
            raise LinkLost(f"ROS has not answered within {START_TIMEOUT:g} s") from None
        self._socket.setblocking(False)
        return str(packet["ready"])

    def received(self) -> Iterator[Packet]:
        """Packets that have come since, oldest first. Raises LinkLost."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(MAX_PACKETS_PER_STEP):
                yield self._read()

    def send(self, packet: Packet) -> None:
        """Hand over a packet; it is lost where the other side does not keep up."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
            self._socket.send(json.dumps(packet).encode())

    def close(self) -> None:
        """End the process, which signs off first."""
        self._socket.close()
        try:
            self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self) -> Packet:
        try:
            data = self._socket.recv(MAX_PACKET_SIZE)
        except ConnectionResetError:
            data = b""
        if not data:
            raise LinkLost("the process that speaks ROS has ended")
        packet: Packet = json.loads(data)
        if "ended" in packet:
            raise LinkLost(packet["ended"])
        return packet
