"""Messages of ROS 2 that differ in stamps and numbers alone, many serialised at a time.

One is serialised by the library, with values in it that occur nowhere else; where their bytes are found, those of the
true values are put. What the library needs 30 µs for then takes one.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
_T = TYPES.types
_SECONDS, _NANOSECONDS = 0x3A7B6C5D, 0x2F1E4D3C
_STAMP = np.array([_SECONDS, _NANOSECONDS], "<u4").tobytes()
"""Of no time that is ever recorded."""
Make = Callable[[Any, NDArray[np.floating[Any]]], Any]
"""A message of a stamp and of k numbers."""


class Template:
    """Messages of one type that have k double-precision numbers each."""

    def __init__(self, kind: str, count: int, make: Make) -> None:
        numbers = np.pi * 1e-300 * np.arange(1.0, count + 1)
        message = make(_T["builtin_interfaces/msg/Time"](sec=_SECONDS, nanosec=_NANOSECONDS), numbers)
        data = bytes(TYPES.serialize_cdr(message, kind))
        self._bytes = np.frombuffer(data, np.uint8)
        self._numbers = _each_byte([_only(data, number.tobytes()) for number in numbers.astype("<f8")])
        self._stamps = [_each_byte([at]) for at in _all(data, _STAMP)]

    def filled(self, times: NDArray[np.int64], numbers: NDArray[np.float64]) -> list[bytes]:
        """n messages, stamped with times, ns, (n,), of numbers (n, k)."""
        rows = np.tile(self._bytes, (len(times), 1))
        rows[:, self._numbers] = _as_bytes(numbers.astype("<f8"))
        stamps = _as_bytes(np.column_stack(np.divmod(times, 10**9)).astype("<u4"))
        for at in self._stamps:
            rows[:, at] = stamps
        data, size = rows.tobytes(), rows.shape[1]
        return [data[at : at + size] for at in range(0, len(data), size)]


def _as_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)


def _each_byte(starts: list[int]) -> NDArray[np.intp]:
    """Of values of eight bytes that begin there."""
    return np.asarray(np.add.outer(np.array(starts, np.intp), np.arange(8)).ravel())


def _only(data: bytes, value: bytes) -> int:
    (at,) = _all(data, value)
    return at


def _all(data: bytes, value: bytes) -> list[int]:
    return [at for at in range(len(data)) if data.startswith(value, at)]
