"""Node of ROS 2, Humble or later, implemented with rclpy."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.signals import SignalHandlerOptions


class Ros2:
    """Node of ROS 2, which publishes and receives messages.

    Args:
        name: Name of the node.
        on_end: Function that is called with the reason as text if ROS ends the node.
    """

    where = "ROS 2"

    def __init__(self, name: str, on_end: Callable[[str], None]) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(name)
        self._on_end = on_end
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        """Receive messages and call the callbacks, until ROS ends the node; runs in a separate thread."""
        try:
            rclpy.spin(self._node)
        finally:
            self._on_end("ROS has ended the node")

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """Convert a time in ns to the time type of ROS 2 messages."""
        return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def publisher(self, topic: str, kind: Any) -> Callable[[Any], None]:
        """Return a function that publishes a message of the class `kind` on the topic `topic`."""
        publish: Callable[[Any], None] = self._node.create_publisher(kind, topic, 10).publish
        return publish

    def subscribe(self, topic: str, kind: Any, callback: Callable[[Any], None]) -> None:
        """Call `callback` with each message on a topic, in the thread that receives messages.

        Args:
            topic: Name of the topic.
            kind: Class of the messages.
            callback: Function that is called with each message.
        """
        self._node.create_subscription(kind, topic, callback, 10)

    @staticmethod
    def close() -> None:
        """Shut ROS 2 down in this process, which ends the node."""
        rclpy.try_shutdown()
