"""What ROS 1 lacks against strangers who connect to a node: web pages, and whoever connects and then says nothing."""

from __future__ import annotations

from typing import Any

PATIENCE = 1.0
"""For whoever connects to begin with what it wants, s; others wait for so long."""


def refuse_web_pages(handler: Any) -> None:
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


def wait_for_nobody(connections: Any) -> None:
    """Have that module of rospy give up connections that do not begin: it accepts one after the other, and a silent one
    would keep every later subscriber out."""
    read = connections.read_ros_handshake_header

    def read_in_time(connection: Any, *arguments: Any) -> Any:
        before = connection.gettimeout()
        connection.settimeout(PATIENCE)
        try:
            return read(connection, *arguments)
        finally:
            connection.settimeout(before)

    connections.read_ros_handshake_header = read_in_time
