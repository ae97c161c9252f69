"""Checksum of Unitree's messages: CRC-32 with the polynomial 0x04C11DB7 over the words of the message in memory.

Each word of four bytes enters the checksum from its most significant bit on. The start value is 0xFFFFFFFF, and the
result is not inverted (CRC-32/MPEG-2).
"""

import zlib

import numpy as np

from live.unitree.messages import UnitreeMessage

_WORD = 4
"""Size of a word, bytes."""
_MIRRORED = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))
"""Value of a byte -> the value with its bits in reverse order."""


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC-32/MPEG-2 of `data`.

    The CRC-32 of `zlib` has the same polynomial, but it takes and gives bits in reverse order, and it inverts the
    result.
    """
    reversed_crc = zlib.crc32(data.translate(_MIRRORED)) ^ 0xFFFFFFFF
    return int(f"{reversed_crc:032b}"[::-1], 2)


def checksum(message: UnitreeMessage) -> int:
    """Return the checksum of a message: of all its words except the last word, which is the field `crc`."""
    words = message.memory()[:-_WORD].reshape(-1, _WORD)
    return crc32_mpeg2(np.ascontiguousarray(words[:, ::-1]).tobytes())


def seal(message: UnitreeMessage) -> None:
    """Write the checksum of a message into its field `crc`."""
    message.set("crc", checksum(message))


def is_intact(message: UnitreeMessage) -> bool:
    """Return True if the field `crc` of a message is its checksum."""
    return int(message.get("crc")[0]) == checksum(message)
