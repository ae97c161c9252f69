"""Node of ROS 1 with rospy; it starts a master if there is none."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import rosgraph
import rosgraph.xmlrpc
import rosmaster.master
import rospy

QUEUE_SIZE = 100
"""Maximum messages that wait for a slow subscriber or for this node; older ones are dropped."""

MASTER_TIMEOUT = 3.0
"""s. Limit for a master to answer."""


class Ros1:
    """Node of ROS 1; OSError if no master answers and none can be started.

    Args:
        name: Name of the node.
        on_end: Called with the reason when ROS ends the node.
    """

    def __init__(self, name: str, on_end: Callable[[str], None]) -> None:
        _refuse_web_pages(rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler)
        uri = rosgraph.get_master_uri()
        self.where = "ROS 1, master " + uri
        socket.setdefaulttimeout(MASTER_TIMEOUT)  # another program may listen there
        online = rosgraph.is_master_online()
        socket.setdefaulttimeout(None)
        if not online:
            _start_master(uri)
            self.where += ", begun here"
        rospy.init_node(name, disable_signals=True)
        rospy.on_shutdown(lambda: on_end("ROS has ended the node: rosnode kill, or another node of the same name"))

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """Return a time in `nanoseconds` as messages contain it."""
        return rospy.Time(nanoseconds // 10**9, nanoseconds % 10**9)

    @staticmethod
    def publisher(topic: str, kind: Any) -> Callable[[Any], None]:
        """Return a function that publishes messages of type `kind` on `topic`."""
        publish: Callable[[Any], None] = rospy.Publisher(topic, kind, queue_size=QUEUE_SIZE, tcp_nodelay=True).publish
        return publish

    @staticmethod
    def subscribe(topic: str, kind: Any, callback: Callable[[Any], None]) -> None:
        """Call `callback` with messages of type `kind` on `topic`, in a thread of the publisher's connection."""
        rospy.Subscriber(topic, kind, callback, queue_size=QUEUE_SIZE, tcp_nodelay=True)

    @staticmethod
    def close() -> None:
        """Unregister from the master."""
        rospy.signal_shutdown("the simulation has ended")


def _start_master(uri: str) -> None:
    """Start a ROS master, or raise OSError if its port is taken."""
    port = urlsplit(uri).port or rosmaster.master.DEFAULT_MASTER_PORT
    address = rosgraph.network.get_bind_address()
    with socket.socket() as probe:  # a master reports a taken port nowhere
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as error:
            raise OSError(f"no ROS master answers at {uri}, and none can listen there: {error}") from error
    rosmaster.master.Master(port).start()


def _refuse_web_pages(handler: Any) -> None:
    """Let a class of HTTP request handlers refuse requests of web pages, which always name their origin.

    No ROS client names one. Otherwise any page in a browser on this machine could end nodes or act as a publisher.
    """
    answer = handler.do_POST

    def answer_or_refuse(self: Any) -> None:
        if self.headers.get("Origin") is None:
            answer(self)
        else:
            self.close_connection = True
            self.send_error(403, "requests of web pages are refused")

    handler.do_POST = answer_or_refuse
