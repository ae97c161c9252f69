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
"""Maximum number of messages that wait for a slow subscriber or for this node; the oldest are dropped."""

MASTER_TIMEOUT = 3.0
"""Time within which a ROS master (name server of ROS 1) must answer, s; otherwise the node starts a master."""


class Ros1:
    """Node of ROS 1, which publishes and receives messages.

    The ROS master is the name server of ROS 1. The constructor raises OSError if no ROS master answers, and no ROS
    master can be started.

    Args:
        name: Name of the node.
        on_end: Function that is called with the reason as text if ROS ends the node.
    """

    def __init__(self, name: str, on_end: Callable[[str], None]) -> None:
        _refuse_web_pages(rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler)
        uri = rosgraph.get_master_uri()
        self.where = "ROS 1, master " + uri
        # A time limit is needed, because a program that is no ROS master may listen at the URI and never answer.
        socket.setdefaulttimeout(MASTER_TIMEOUT)
        online = rosgraph.is_master_online()
        socket.setdefaulttimeout(None)
        if not online:
            _start_master(uri)
            self.where += ", begun here"
        rospy.init_node(name, disable_signals=True)
        rospy.on_shutdown(lambda: on_end("ROS has ended the node: rosnode kill, or another node of the same name"))

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """Convert a time in ns to the time type of ROS 1 messages."""
        return rospy.Time(nanoseconds // 10**9, nanoseconds % 10**9)

    @staticmethod
    def publisher(topic: str, kind: Any) -> Callable[[Any], None]:
        """Return a function that publishes a message of the class `kind` on the topic `topic`."""
        publish: Callable[[Any], None] = rospy.Publisher(topic, kind, queue_size=QUEUE_SIZE, tcp_nodelay=True).publish
        return publish

    @staticmethod
    def subscribe(topic: str, kind: Any, callback: Callable[[Any], None]) -> None:
        """Call `callback` with each message on a topic, in the thread that reads the publisher's connection.

        Args:
            topic: Name of the topic.
            kind: Class of the messages.
            callback: Function that is called with each message.
        """
        rospy.Subscriber(topic, kind, callback, queue_size=QUEUE_SIZE, tcp_nodelay=True)

    @staticmethod
    def close() -> None:
        """End the node, which unregisters it from the ROS master."""
        rospy.signal_shutdown("the simulation has ended")


def _start_master(uri: str) -> None:
    """Start a ROS master in this process at a URI; raise OSError if the port of the URI is in use."""
    port = urlsplit(uri).port or rosmaster.master.DEFAULT_MASTER_PORT
    address = rosgraph.network.get_bind_address()
    # The port is tested before the start, because a ROS master does not report that its port is in use.
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as error:
            raise OSError(f"no ROS master answers at {uri}, and none can listen there: {error}") from error
    rosmaster.master.Master(port).start()


def _refuse_web_pages(handler: Any) -> None:
    """Change a class of HTTP request handlers so that it refuses requests from web pages.

    Otherwise any page in a browser on this machine could end ROS nodes or act as a publisher. Requests from web pages
    have the HTTP header `Origin`; requests from ROS clients do not.

    Args:
        handler: Class of the request handlers of ROS 1, which is changed in place.
    """
    answer = handler.do_POST

    def answer_or_refuse(self: Any) -> None:
        if self.headers.get("Origin") is None:
            answer(self)
        else:
            self.close_connection = True
            self.send_error(403, "requests of web pages are refused")

    handler.do_POST = answer_or_refuse
