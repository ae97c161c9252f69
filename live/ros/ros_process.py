"""Simulation side of the ROS process: starts the process and exchanges packets with it over a socket."""

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
"""Time limit for the process to start a ROS node, s."""
MAX_PACKETS_PER_STEP = 500
"""Maximum number of packets that are read in one control step; further packets wait for the next step."""
EXIT_TIMEOUT = 2.0
"""Time limit for the process to end after `close`, s; a process that takes longer is killed."""

Packet = dict[str, Any]
"""Content of a packet, sent as JSON: name -> value."""


class RosProcessError(UsageError):
    """Error if the ROS process cannot start, does not answer or has ended; the message gives the reason."""


class RosProcess:
    """Runs the ROS process and exchanges packets with it.

    Neither process waits for the other during the simulation.

    Args:
        command: Command line of the process.
        environment: Environment variables of the process.

    Raises:
        RosProcessError: This system is not Linux.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        if sys.platform != "linux":
            raise RosProcessError("the ROS node runs on Linux alone: in a container or a virtual machine elsewhere")
        # A sequential-packet socket pair, because packets arrive complete or not at all. No other process can connect,
        # because the socket has no address.
        self._socket, child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with child_socket:
            # The process has its own session so that Ctrl-C does not reach it, because the simulation ends the process.
            self._process = subprocess.Popen(
                command, stdin=child_socket.fileno(), env=dict(environment), start_new_session=True
            )
        self._socket.settimeout(START_TIMEOUT)

    def wait_until_ready(self) -> str:
        """Wait until the process has started a ROS node.

        Returns:
            Description of the node: version of ROS, and the master of ROS 1.

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
        """Yield the packets since the last call, oldest first; raise RosProcessError if the process ended."""
        with contextlib.suppress(BlockingIOError):
            for _ in range(MAX_PACKETS_PER_STEP):
                yield self._read()

    def send(self, packet: Packet) -> None:
        """Send a `packet` to the process; the packet is dropped if the process does not read fast enough."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
            self._socket.send(json.dumps(packet).encode())

    def close(self) -> None:
        """End the process, after the process has unregistered the ROS node."""
        self._socket.close()
        try:
            self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self) -> Packet:
        """Return the next packet; raise RosProcessError if the process has ended."""
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
