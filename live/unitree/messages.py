"""Messages of Unitree's quadrupeds as bytes: fields, their offsets on the network, and their offsets in memory.

On the network, a message is a little-endian CDR stream: each number is aligned to its size. In the memory of a C
program, each structure is aligned and padded as well. The checksum of a message covers the bytes in memory.
"""

import math
import re
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

NAMESPACE = "unitree_go.msg.dds_"
"""Module of the message types in the names that programs find them by."""
STRUCTURES = {
    "TimeSpec_": "sec:int32 nanosec:uint32",
    "IMUState_": "quaternion:float32[4] gyroscope:float32[3] accelerometer:float32[3] rpy:float32[3] temperature:uint8",
    "MotorCmd_": "mode:uint8 q:float32 dq:float32 tau:float32 kp:float32 kd:float32 reserve:uint32[3]",
    "MotorState_": (
        "mode:uint8 q:float32 dq:float32 ddq:float32 tau_est:float32 q_raw:float32 dq_raw:float32 ddq_raw:float32 "
        "temperature:uint8 lost:uint32 reserve:uint32[2]"
    ),
    "BmsCmd_": "off:uint8 reserve:uint8[3]",
    "BmsState_": (
        "version_high:uint8 version_low:uint8 status:uint8 soc:uint8 current:int32 cycle:uint16 bq_ntc:uint8[2] "
        "mcu_ntc:uint8[2] cell_vol:uint16[15]"
    ),
    "PathPoint_": "t_from_start:float32 x:float32 y:float32 yaw:float32 vx:float32 vy:float32 vyaw:float32",
    "LowCmd_": (
        "head:uint8[2] level_flag:uint8 frame_reserve:uint8 sn:uint32[2] version:uint32[2] bandwidth:uint16 "
        "motor_cmd:MotorCmd_[20] bms_cmd:BmsCmd_ wireless_remote:uint8[40] led:uint8[12] fan:uint8[2] gpio:uint8 "
        "reserve:uint32 crc:uint32"
    ),
    "LowState_": (
        "head:uint8[2] level_flag:uint8 frame_reserve:uint8 sn:uint32[2] version:uint32[2] bandwidth:uint16 "
        "imu_state:IMUState_ motor_state:MotorState_[20] bms_state:BmsState_ foot_force:int16[4] "
        "foot_force_est:int16[4] tick:uint32 wireless_remote:uint8[40] bit_flag:uint8 adc_reel:float32 "
        "temperature_ntc1:uint8 temperature_ntc2:uint8 power_v:float32 power_a:float32 fan_frequency:uint16[4] "
        "reserve:uint32 crc:uint32"
    ),
    "SportModeState_": (
        "stamp:TimeSpec_ error_code:uint32 imu_state:IMUState_ mode:uint8 progress:float32 gait_type:uint8 "
        "foot_raise_height:float32 position:float32[3] body_height:float32 velocity:float32[3] yaw_speed:float32 "
        "range_obstacle:float32[4] foot_force:int16[4] foot_position_body:float32[12] foot_speed_body:float32[12] "
        "path_point:PathPoint_[10]"
    ),
    "WirelessController_": "lx:float32 ly:float32 rx:float32 ry:float32 keys:uint16",
}
"""Name of a message type -> its fields in order, each NAME:TYPE or NAME:TYPE[COUNT]; a structure is before its users.

The repository unitreerobotics/unitree_sdk2_python has the same fields.
"""
HEADER = b"\x00\x01\x00\x00"
"""First bytes of a message on the network: CDR, little-endian, no options."""
_FIELD = re.compile(r"(\w+):(\w+?)(?:\[(\d+)\])?")


class Member(NamedTuple):
    """Field of a message type."""

    name: str
    kind: str
    """Name of a NumPy number type or of a structure."""
    length: int | None
    """Number of items of an array; None for a field that is no array."""


class _Leaf(NamedTuple):
    """Number in a message."""

    path: str
    """Names of the fields that contain the number, separated by dots."""
    kind: str
    offset: int
    """Offset from the first byte after the header, bytes."""


class _Field(NamedTuple):
    """All numbers of a message with one path."""

    dtype: Any
    offsets: NDArray[np.intp]
    """Offset of each number from the first byte after the header, bytes."""
    stride: int | None
    """Distance between the numbers, bytes; None if the distances differ."""


class Layout(NamedTuple):
    """Positions of the numbers of a message type on the network and in the memory of a C program."""

    size: int
    """Size on the network without the header, bytes."""
    fields: dict[str, _Field]
    """Path of a field -> its numbers."""
    memory_size: int
    """Size in memory, bytes."""
    stream_index: NDArray[np.intp]
    """Offset of each byte of a number on the network; padding is absent."""
    memory_index: NDArray[np.intp]
    """Offset of the same bytes in memory."""


@cache
def members(name: str) -> tuple[Member, ...]:
    """Return the fields of the message type `name`, in order."""
    matches = [_FIELD.fullmatch(word) for word in STRUCTURES[name].split()]
    return tuple(Member(match[1], match[2], int(match[3]) if match[3] else None) for match in matches if match)


@cache
def layout(name: str) -> Layout:
    """Return the positions of all numbers of the message type `name`."""
    stream = list(_leaves(name, 0, "", in_memory=False))
    memory = list(_leaves(name, 0, "", in_memory=True))
    paths: dict[str, list[_Leaf]] = {}
    for leaf in stream:
        paths.setdefault(leaf.path, []).append(leaf)
    last = memory[-1]
    return Layout(
        size=stream[-1].offset + _size(stream[-1].kind),
        fields={path: _field(leaves) for path, leaves in paths.items()},
        memory_size=_aligned(last.offset + _size(last.kind), _alignment(name)),
        stream_index=np.concatenate([leaf.offset + np.arange(_size(leaf.kind)) for leaf in stream]),
        memory_index=np.concatenate([leaf.offset + np.arange(_size(leaf.kind)) for leaf in memory]),
    )


def _field(leaves: list[_Leaf]) -> _Field:
    """Return the numbers `leaves` of one path as a field."""
    dtype = np.dtype(leaves[0].kind).newbyteorder("<")
    offsets = np.array([leaf.offset for leaf in leaves])
    distances = set(np.diff(offsets).tolist()) or {dtype.itemsize}
    return _Field(dtype, offsets, distances.pop() if len(distances) == 1 else None)


def _leaves(name: str, start: int, prefix: str, in_memory: bool) -> Iterator[_Leaf]:
    """Yield all numbers of a structure that follows byte `start`, in order.

    Args:
        name: Message type of the structure.
        start: Offset of the first byte that is free, bytes.
        prefix: Path of the structure with a dot at its end; empty for a whole message.
        in_memory: True for the offsets in memory, False for the offsets on the network.

    Yields:
        Each number with its path and offset.
    """
    end = start
    for member in members(name):
        path = prefix + member.name
        for _ in range(member.length or 1):
            if member.kind not in STRUCTURES:
                end = _aligned(end, _size(member.kind))
                yield _Leaf(path, member.kind, end)
                end += _size(member.kind)
                continue
            end = _aligned(end, _alignment(member.kind)) if in_memory else end
            for leaf in _leaves(member.kind, end, f"{path}.", in_memory):
                yield leaf
                end = leaf.offset + _size(leaf.kind)
            end = _aligned(end, _alignment(member.kind)) if in_memory else end


def _alignment(name: str) -> int:
    """Return the alignment of a structure in memory, bytes: the largest alignment of its fields."""
    kinds = (member.kind for member in members(name))
    return max(_alignment(kind) if kind in STRUCTURES else _size(kind) for kind in kinds)


def _size(kind: str) -> int:
    """Return the size of a number of type `kind`, bytes."""
    return np.dtype(kind).itemsize


def _aligned(offset: int, alignment: int) -> int:
    """Return the smallest multiple of `alignment` that is not below `offset`."""
    return math.ceil(offset / alignment) * alignment


class Received(NamedTuple):
    """Message that a subscription has received."""

    data: bytes
    """Bytes of the message on the network, with the header."""
    writer: int
    """Number of the writer of the message."""


class UnitreeMessage:
    """Message of one type, with fields that are read and written in its bytes.

    Args:
        name: Name of the message type.
        data: Bytes on the network with the header; None for a message of zeros.

    Raises:
        ValueError: The bytes are no message of this type.
    """

    def __init__(self, name: str, data: bytes | None = None) -> None:
        self.name = name
        self._layout = layout(name)
        size = len(HEADER) + self._layout.size
        if data is not None and (len(data) < size or data[:2] != HEADER[:2]):
            raise ValueError(f"{name}: no message of this type, got {len(data)} bytes; valid: {size} bytes of CDR")
        self._data = bytearray(HEADER + bytes(self._layout.size)) if data is None else bytearray(data[:size])
        self._bytes = np.frombuffer(self._data, np.uint8)[len(HEADER) :]

    def get(self, path: str) -> NDArray[Any]:
        """Return a copy of all numbers of a field, (count,); `path` is, for example, `motor_cmd.q`."""
        field = self._layout.fields[path]
        if field.stride is not None:
            return self._view(field, field.stride).copy()
        index = field.offsets[:, None] + np.arange(field.dtype.itemsize)
        numbers: NDArray[Any] = self._bytes[index].view(field.dtype)[:, 0]
        return numbers

    def set(self, path: str, values: ArrayLike) -> None:
        """Set all numbers of a field.

        Args:
            path: Path of the field, for example `motor_cmd.q`.
            values: New numbers, (count,), or one number for all.
        """
        field = self._layout.fields[path]
        if field.stride is not None:
            self._view(field, field.stride)[:] = values
            return
        numbers = np.broadcast_to(np.asarray(values, field.dtype), len(field.offsets)).copy()
        index = field.offsets[:, None] + np.arange(field.dtype.itemsize)
        self._bytes[index] = numbers[:, None].view(np.uint8)

    def to_bytes(self) -> bytes:
        """Return the bytes of the message on the network, with the header."""
        return bytes(self._data)

    def memory(self) -> NDArray[np.uint8]:
        """Return the bytes of the message in the memory of a C program; padding is zero."""
        memory = np.zeros(self._layout.memory_size, np.uint8)
        memory[self._layout.memory_index] = self._bytes[self._layout.stream_index]
        return memory

    def _view(self, field: _Field, stride: int) -> NDArray[Any]:
        """Return a view of the numbers of `field`, which are `stride` bytes apart."""
        start = len(HEADER) + int(field.offsets[0])
        return np.ndarray((len(field.offsets),), field.dtype, self._data, start, (stride,))
