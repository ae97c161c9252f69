"""ROS 1 by rospy, with a master of its own where there is none."""

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
"""Messages that wait for a slow subscriber, or for us; older ones are dropped."""

MASTER_TIMEOUT = 3.0
"""For a master to answer, s."""


class Ros1:
    """A node of ROS 1. Raises OSError, in words, where there is neither a master nor room for one."""

    def __init__(self, name: str, ended: Callable[[str], None]) -> None:
        _refuse_web_pages(rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler)
        uri = rosgraph.get_master_uri()
        self.where = "ROS 1, master " + uri
        socket.setdefaulttimeout(MASTER_TIMEOUT)  # what listens there may not be a master
        online = rosgraph.is_master_online()
        socket.setdefaulttimeout(None)
        if not online:
            _begin_master(uri)
            self.where += ", begun here"
        rospy.init_node(name, disable_signals=True)
        rospy.on_shutdown(lambda: ended("ROS has ended the node: rosnode kill, or another node of the same name"))

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """A time as messages have it."""
        return rospy.Time(nanoseconds // 10**9, nanoseconds % 10**9)

    @staticmethod
    def publisher(topic: str, kind: Any) -> Callable[[Any], None]:
        """Publishes messages of that type."""
        publish: Callable[[Any], None] = rospy.Publisher(topic, kind, queue_size=QUEUE_SIZE, tcp_nodelay=True).publish
        return publish

    @staticmethod
    def subscribe(topic: str, kind: Any, take: Callable[[Any], None]) -> None:
        """Have every message taken, in a thread of its publisher's connection."""
        rospy.Subscriber(topic, kind, take, queue_size=QUEUE_SIZE, tcp_nodelay=True)

    @staticmethod
    def close() -> None:
        """Sign off from the master."""
        rospy.signal_shutdown("the simulation has ended")


def _begin_master(uri: str) -> None:
    port = urlsplit(uri).port or rosmaster.master.DEFAULT_MASTER_PORT
    address = rosgraph.network.get_bind_address()
    with socket.socket() as probe:  # a master without room for it would say so nowhere
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as error:
            raise OSError(f"no ROS master answers at {uri}, and none can listen there: {error}") from error
    rosmaster.master.Master(port).start()


def _refuse_web_pages(handler: Any) -> None:
    """Have that class of HTTP request handlers refuse what a browser sends for a page, which always names its origin.

    No ROS client does. Otherwise any page that is open in a browser here could end nodes or stand in for a publisher.
    """
    answer = handler.do_POST

    def do_POST(self: Any) -> None:
        if self.headers.get("Origin") is None:
            answer(self)
        else:
            self.close_connection = True
            self.send_error(403, "requests of web pages are refused")

    handler.do_POST = do_POST
