"""Starts and stops the ROS process, and exchanges packets with it over a socket.

The ROS process connects the simulated robot to ROS; the simulation itself does not import ROS.
"""

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
"""Time within which the ROS process must have started a ROS node, s."""
MAX_PACKETS_PER_STEP = 500
"""Maximum number of packets that are read in one control step; further packets are read in the next step."""
EXIT_TIMEOUT = 2.0
"""Time within which the ROS process must end after `close`, s; otherwise the process is killed."""

Packet = dict[str, Any]
"""Message between the simulation and the ROS process, sent as a JSON object: name -> value."""


class RosProcessError(UsageError):
    """Raised if the ROS process cannot start, does not answer or has ended; the message gives the reason."""


class RosProcess:
    """Runs the ROS process, and exchanges packets (JSON messages) between the simulation and the ROS process.

    During the simulation, neither process waits for the other.

    Args:
        command: Command line of the ROS process.
        environment: Environment variables of the ROS process: name -> value.

    Raises:
        RosProcessError: This system is not Linux.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        if sys.platform != "linux":
            raise RosProcessError("the ROS node runs on Linux alone: in a container or a virtual machine elsewhere")
        # The sockets are of the type "sequential packets", because these packets arrive complete or not at all.
        # The sockets have no address, so that no other process can connect to them.
        self._socket, child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with child_socket:
            # The ROS process runs in a session of its own, because Ctrl-C must not end it: the simulation ends it.
            self._process = subprocess.Popen(
                command, stdin=child_socket.fileno(), env=dict(environment), start_new_session=True
            )
        self._socket.settimeout(START_TIMEOUT)

    def wait_until_ready(self) -> str:
        """Wait until the ROS process has started a ROS node.

        Returns:
            Description of the node: the version of ROS, and for ROS 1 the URI of the ROS master.

        Raises:
            RosProcessError: The ROS process has not answered within START_TIMEOUT, or has ended.
        """
        try:
            packet = self._read()
        except TimeoutError:
            raise RosProcessError(f"ROS has not answered within {START_TIMEOUT:g} s") from None
        self._socket.setblocking(False)
        return str(packet["ready"])

    def received(self) -> Iterator[Packet]:
        """Yield the packets that the ROS process has sent since the last call.

        Raises RosProcessError if the ROS process has ended.
        """
        with contextlib.suppress(BlockingIOError):
            for _ in range(MAX_PACKETS_PER_STEP):
                yield self._read()

    def send(self, packet: Packet) -> None:
        """Send a packet to the ROS process; the packet is dropped if the process does not read fast enough."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
            self._socket.send(json.dumps(packet).encode())

    def close(self) -> None:
        """End the ROS process, after it has unregistered its node from ROS."""
        self._socket.close()
        try:
            self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self) -> Packet:
        """Read the next packet from the ROS process; raise RosProcessError if the process has ended."""
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
