"""Messages over DDS with Cyclone DDS: publishers and subscriptions of Unitree's message types.

Only this module imports the package `cyclonedds`. Messages are sent and received as bytes, because the package's own
conversion of a robot state takes longer than a physics step.
"""

import contextlib
import socket
from functools import cache
from typing import Any
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import annotations, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from live.unitree.messages import HEADER, NAMESPACE, STRUCTURES, Received, UnitreeMessage, members
from quad_env.cli.command_line import UsageError

LOOPBACK = "lo"
"""Name of the network interface that other machines cannot reach; it stands for 127.0.0.1 on every system."""
QUEUE_LENGTH = 256
"""Number of received messages that wait until they are taken; older messages are dropped."""
_MAX_PARTICIPANTS = 32
"""Largest number of programs that find each other on the loopback interface."""
_ENCODING = HEADER[:2]
_RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=1))
"""Reliability of publishers; a publisher waits for slow readers at most this long."""


class _Payload:
    """Bytes of a received message, to which the package attaches its `sample_info`."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None


@cache
def message_type(name: str) -> Any:
    """Return the DDS type of the message type `name`; its instances are made from field values, as in the SDK."""
    fields: dict[str, Any] = {}
    for member in members(name):
        item = message_type(member.kind) if member.kind in STRUCTURES else getattr(types, member.kind)
        fields[member.name] = item if member.length is None else types.array[item, member.length]
    made = make_idl_struct(name, f"{NAMESPACE}.{name}", fields)
    return annotations.final(annotations.autoid("sequential")(made))


@cache
def _raw_type(name: str) -> Any:
    """Return a type that other programs see as `message_type(name)`, and that this program sends as bytes."""

    def serialize(payload: Any, **_: Any) -> bytes:
        """Return the bytes of a message that is sent."""
        data: bytes = payload.data
        return data

    def deserialize(_: Any, /, data: bytes, **__: Any) -> _Payload:
        """Return the bytes of a received message as little-endian CDR, which nearly every writer sends."""
        if data[: len(_ENCODING)] != _ENCODING:
            data = message_type(name).deserialize(data).serialize()
        return _Payload(bytes(data))

    made: Any = message_type.__wrapped__(name)
    made.serialize = serialize
    made.deserialize = classmethod(deserialize)
    return made


class Bus:
    """Participant of a DDS domain on one network interface; its publishers and subscriptions exchange messages.

    Args:
        domain: Number of the domain, 0 to 232.
        interface: Name of the network interface; `LOOPBACK` for programs of this machine alone.

    Raises:
        UsageError: The interface does not exist, or Cyclone DDS cannot use it.
    """

    def __init__(self, domain: int, interface: str = LOOPBACK) -> None:
        names = [name for _, name in socket.if_nameindex()]
        if interface != LOOPBACK and interface not in names:
            raise UsageError(
                f"--interface: no network interface of this name, got {interface}; valid: {' '.join(names)}"
            )
        try:
            self._domain = Domain(domain, _configuration(interface))
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise UsageError(f"--interface: Cyclone DDS cannot use {interface} in domain {domain} ({error})") from error

    def publisher(self, topic: str, name: str) -> "Publisher":
        """Return a publisher of messages of the type `name` on a topic."""
        writer = DataWriter(self._participant, self._topic(topic, name), Qos(_RELIABLE, Policy.History.KeepLast(1)))
        return Publisher(self, writer, name)

    def subscribe(self, topic: str, name: str) -> "Subscription":
        """Return a subscription to messages of the type `name` on a topic."""
        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(QUEUE_LENGTH))
        return Subscription(self, DataReader(self._participant, self._topic(topic, name), qos))

    def _topic(self, topic: str, name: str) -> Any:
        """Return the DDS topic called `topic` with messages of the type `name`."""
        return Topic(self._participant, topic, _raw_type(name))


class Publisher:
    """Publisher of messages of one type on one topic.

    Args:
        bus: Participant, which exists as long as the publisher.
        writer: Writer of the package `cyclonedds`.
        name: Name of the message type.
    """

    def __init__(self, bus: Bus, writer: Any, name: str) -> None:
        self._bus = bus
        self._writer = writer
        self._payload = _raw_type(name).__new__(_raw_type(name))

    def write(self, message: UnitreeMessage) -> None:
        """Send a message; it is lost if a reliable reader on the network does not keep up."""
        self._payload.data = message.to_bytes()
        with contextlib.suppress(DDSException):
            self._writer.write(self._payload)


class Subscription:
    """Subscription to messages of one type on one topic.

    Args:
        bus: Participant, which exists as long as the subscription.
        reader: Reader of the package `cyclonedds`.
    """

    def __init__(self, bus: Bus, reader: Any) -> None:
        self._bus = bus
        self._reader = reader

    def take(self) -> list[Received]:
        """Return the messages that have arrived since the last call, oldest first; at most `QUEUE_LENGTH`."""
        samples = self._reader.take(QUEUE_LENGTH)
        return [
            Received(sample.data, int(sample.sample_info.publication_handle))
            for sample in samples
            if isinstance(sample, _Payload)
        ]


def _configuration(interface: str) -> str:
    """Return the configuration of Cyclone DDS, XML, for a network interface.

    On the loopback interface, the programs of this project find each other at 127.0.0.1 without multicast. Programs of
    Unitree's SDK search by multicast on this interface, so it is allowed for the search; nothing leaves the machine.
    """
    if interface != LOOPBACK:
        return (
            f"<CycloneDDS><Domain Id='any'><General><Interfaces><NetworkInterface name={quoteattr(interface)}/>"
            "</Interfaces></General></Domain></CycloneDDS>"
        )
    return (
        "<CycloneDDS><Domain Id='any'><General><AllowMulticast>spdp</AllowMulticast>"
        "<MulticastTimeToLive>0</MulticastTimeToLive><Interfaces>"
        "<NetworkInterface address='127.0.0.1' multicast='true'/></Interfaces></General><Discovery>"
        f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{_MAX_PARTICIPANTS}"
        "</MaxAutoParticipantIndex><Peers><Peer Address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
    )
