"""Node of ROS 2, Humble or later, implemented with rclpy."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.signals import SignalHandlerOptions


class Ros2:
    """Node of ROS 2.

    Args:
        name: Name of the node.
        on_end: Function that is called with the reason if ROS ends the node.
    """

    where = "ROS 2"

    def __init__(self, name: str, on_end: Callable[[str], None]) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(name)
        self._on_end = on_end
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        """Process messages until ROS ends the node."""
        try:
            rclpy.spin(self._node)
        finally:
            self._on_end("ROS has ended the node")

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """Convert a time, `nanoseconds`, to the time type of ROS messages."""
        return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def publisher(self, topic: str, kind: Any) -> Callable[[Any], None]:
        """Return a function that publishes messages of type `kind` on `topic`."""
        publish: Callable[[Any], None] = self._node.create_publisher(kind, topic, 10).publish
        return publish

    def subscribe(self, topic: str, kind: Any, callback: Callable[[Any], None]) -> None:
        """Call `callback` with messages of type `kind` on `topic`, in the thread that processes messages."""
        self._node.create_subscription(kind, topic, callback, 10)

    @staticmethod
    def close() -> None:
        """Shut ROS down, which ends the node."""
        rclpy.try_shutdown()
