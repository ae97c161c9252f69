"""Layout and checksum of Unitree's messages."""

import numpy as np
import pytest
from numpy.typing import NDArray

from live.unitree.checksum import checksum, crc32_mpeg2, is_intact, seal
from live.unitree.messages import HEADER, STRUCTURES, UnitreeMessage, layout, members

TOPIC_TYPES = ("LowCmd_", "LowState_", "SportModeState_", "WirelessController_")


def random_message(name: str) -> UnitreeMessage:
    """Return a message with different numbers in all fields."""
    rng = np.random.default_rng(len(name))
    message = UnitreeMessage(name)
    for path, field in layout(name).fields.items():
        count = len(field.offsets)
        is_float = field.dtype.kind == "f"
        message.set(path, rng.normal(size=count) if is_float else rng.integers(0, 127, count))
    return message


def bitwise_crc(words: NDArray[np.uint32]) -> int:
    """Return the CRC as the SDK defines it: word by word, from the most significant bit on."""
    crc = 0xFFFFFFFF
    for word in words.tolist():
        for bit in range(31, -1, -1):
            carry = (crc >> 31) ^ (word >> bit & 1)
            crc = (crc << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if carry else 0)
    return crc


def test_the_checksum_has_the_check_value_of_the_catalogue_of_crc_algorithms() -> None:
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7


@pytest.mark.parametrize("name", ["LowCmd_", "LowState_"])
def test_the_checksum_is_the_crc_of_the_words_before_the_last(name: str) -> None:
    message = random_message(name)
    assert checksum(message) == bitwise_crc(message.memory().view("<u4")[:-1])


def test_the_checksum_of_a_command_is_that_of_the_sdk() -> None:
    # `unitree_sdk2py.utils.crc.CRC().Crc(command)`, in C and in Python, gave this value for these commands.
    message = UnitreeMessage("LowCmd_")
    message.set("head", (0xFE, 0xEF))
    message.set("level_flag", 0xFF)
    motors = np.arange(20) < 12
    message.set("motor_cmd.mode", motors)
    message.set("motor_cmd.q", 0.25 * np.arange(20) * motors)
    message.set("motor_cmd.kp", 60.0 * motors)
    message.set("motor_cmd.kd", 5.0 * motors)
    assert checksum(message) == 0x7D9EDFFC


def test_the_size_in_memory_is_that_of_the_structures_of_the_sdk() -> None:
    assert (layout("LowCmd_").memory_size, layout("LowState_").memory_size) == (812, 1180)


def test_a_sealed_message_is_intact_until_a_bit_changes() -> None:
    message = random_message("LowCmd_")
    seal(message)
    assert is_intact(message)
    q = message.get("motor_cmd.q")
    q[3] += 1e-3
    message.set("motor_cmd.q", q)
    assert not is_intact(message)


@pytest.mark.parametrize("name", TOPIC_TYPES)
def test_fields_keep_their_numbers_and_leave_others_alone(name: str) -> None:
    message = random_message(name)
    copy = UnitreeMessage(name)
    for path in layout(name).fields:
        copy.set(path, message.get(path))
    assert copy.memory().tobytes() == message.memory().tobytes()
    paths = set(layout(name).fields)
    for path in paths:
        changed = UnitreeMessage(name, message.to_bytes())
        changed.set(path, message.get(path) + 1)
        assert {other for other in paths if (changed.get(other) != message.get(other)).any()} == {path}


@pytest.mark.parametrize("data", [b"", HEADER, b"\x00\x00" + random_message("LowCmd_").to_bytes()[2:]])
def test_bytes_that_are_no_message_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="LowCmd_: no message of this type"):
        UnitreeMessage("LowCmd_", data)


@pytest.mark.parametrize("name", TOPIC_TYPES)
def test_the_bytes_are_those_of_cyclone_dds(name: str) -> None:
    dds = pytest.importorskip("live.unitree.dds", reason="cyclonedds has no wheel here", exc_type=ImportError)
    message = random_message(name)
    sample = dds.message_type(name).deserialize(message.to_bytes())
    assert sample.serialize().ljust(len(message.to_bytes()), b"\0") == message.to_bytes()
    assert type(sample).__idl_typename__ == f"unitree_go.msg.dds_.{name}"
    for member in members(name):
        if member.kind not in STRUCTURES:
            value = getattr(sample, member.name)
            numbers = [value] if member.length is None else list(value)
            assert np.array_equal(numbers, message.get(member.name)), member.name
