"""Node of ROS 1, implemented with rospy; the node starts a ROS master if no master runs."""

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
"""Maximum number of waiting messages, to a slow subscriber or to this node; the oldest are dropped."""

MASTER_TIMEOUT = 3.0
"""Time limit for the answer of a ROS master, s."""


class Ros1:
    """Node of ROS 1.

    The constructor raises OSError if no ROS master answers and no master can be started.

    Args:
        name: Name of the node.
        on_end: Function that is called with the reason if ROS ends the node.
    """

    def __init__(self, name: str, on_end: Callable[[str], None]) -> None:
        _refuse_web_pages(rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler)
        uri = rosgraph.get_master_uri()
        self.where = "ROS 1, master " + uri
        socket.setdefaulttimeout(MASTER_TIMEOUT)  # because another program may listen at the URI
        online = rosgraph.is_master_online()
        socket.setdefaulttimeout(None)
        if not online:
            _start_master(uri)
            self.where += ", begun here"
        rospy.init_node(name, disable_signals=True)
        rospy.on_shutdown(lambda: on_end("ROS has ended the node: rosnode kill, or another node of the same name"))

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """Convert a time, `nanoseconds`, to the time type of ROS messages."""
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
        """Unregister the node from the ROS master."""
        rospy.signal_shutdown("the simulation has ended")


def _start_master(uri: str) -> None:
    """Start a ROS master at a URI; raise OSError if the port of the URI is in use."""
    port = urlsplit(uri).port or rosmaster.master.DEFAULT_MASTER_PORT
    address = rosgraph.network.get_bind_address()
    with socket.socket() as probe:  # because a master does not report a port in use
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as error:
            raise OSError(f"no ROS master answers at {uri}, and none can listen there: {error}") from error
    rosmaster.master.Master(port).start()


def _refuse_web_pages(handler: Any) -> None:
    """Change a class of HTTP request handlers so that it refuses requests from web pages.

    Otherwise any page in a browser on this machine could end nodes or act as a publisher. Requests from web pages have
    the header `Origin`; requests from ROS clients do not.
    """
    answer = handler.do_POST

    def answer_or_refuse(self: Any) -> None:
        if self.headers.get("Origin") is None:
            answer(self)
        else:
            self.close_connection = True
            self.send_error(403, "requests of web pages are refused")

    handler.do_POST = answer_or_refuse
