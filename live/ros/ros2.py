"""ROS 2 by rclpy, Humble or later."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.signals import SignalHandlerOptions


class Ros2:
    """A node of ROS 2."""

    where = "ROS 2"

    def __init__(self, name: str, ended: Callable[[str], None]) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node, self._ended = rclpy.create_node(name), ended
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        try:
            rclpy.spin(self._node)
        finally:
            self._ended("ROS has ended the node")

    @staticmethod
    def stamp(nanoseconds: int) -> Any:
        """A time as messages have it."""
        return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def publisher(self, topic: str, kind: Any) -> Callable[[Any], None]:
        """Publishes messages of that type."""
        publish: Callable[[Any], None] = self._node.create_publisher(kind, topic, 10).publish
        return publish

    def subscribe(self, topic: str, kind: Any, take: Callable[[Any], None]) -> None:
        """Have every message taken, in the thread that spins."""
        self._node.create_subscription(kind, topic, take, 10)

    @staticmethod
    def close() -> None:
        """Leave the network."""
        rclpy.try_shutdown()
