"""Parent side of the ROS process: packets of numbers over a socket between simulation and ROS."""

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
"""s. Limit for the process to become a node."""
MAX_PACKETS_PER_STEP = 500
"""Maximum packets that are read in one control step; a faster sender waits."""
EXIT_TIMEOUT = 2.0
"""s. Limit for the process to unregister from its master; then it is killed."""

Packet = dict[str, Any]
"""Content of a packet, as JSON."""


class RosProcessError(UsageError):
    """The ROS process has ended; the message gives the reason, if it is known."""


class RosProcess:
    """Runs the ROS process and exchanges packets with it; neither side ever blocks the other.

    Args:
        command: Command line of the process.
        environment: Environment of the process.

    Raises:
        RosProcessError: This system is not Linux.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        if sys.platform != "linux":
            raise RosProcessError("the ROS node runs on Linux alone: in a container or a virtual machine elsewhere")
        # Packets arrive whole or not at all, and no other process can connect: the socket has no address.
        self._socket, child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with child_socket:
            # In a session of its own, Ctrl-C does not reach it: the simulation ends it.
            self._process = subprocess.Popen(
                command, stdin=child_socket.fileno(), env=dict(environment), start_new_session=True
            )
        self._socket.settimeout(START_TIMEOUT)

    def wait_until_ready(self) -> str:
        """Wait until the process is a node.

        Returns:
            Description of the node.

        Raises:
            RosProcessError: The process has not answered in time, or has ended.
        """
        try:
            packet = self._read()
        except TimeoutError:
            raise RosProcessError(f"ROS has not answered within {START_TIMEOUT:g} s") from None
        self._socket.setblocking(False)
        return str(packet["ready"])

    def received(self) -> Iterator[Packet]:
        """Yield the packets since the last call, oldest first; RosProcessError if the process has ended."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(MAX_PACKETS_PER_STEP):
                yield self._read()

    def send(self, packet: Packet) -> None:
        """Send a `packet`; it is lost if the other side does not keep up."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
            self._socket.send(json.dumps(packet).encode())

    def close(self) -> None:
        """End the process, which unregisters first."""
        self._socket.close()
        try:
            self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self) -> Packet:
        """Return the next packet, or raise RosProcessError."""
        try:
            data = self._socket.recv(MAX_PACKET_SIZE)
        except ConnectionResetError:
            data = b""
        if not data:
            raise RosProcessError("the process that speaks ROS has ended")
        packet: Packet = json.loads(data)
        if "ended" in packet:
            raise RosProcessError(packet["ended"])
        return packet
