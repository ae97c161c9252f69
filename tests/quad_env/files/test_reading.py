"""User files are read completely or refused at once; pipes, devices and too large files are refused."""

import os
from pathlib import Path

import pytest

from quad_env.files.reading import check_file, has_content, parse_json, read_bytes

if not hasattr(os, "mkfifo"):
    pytest.skip("the system has no such pipes", allow_module_level=True)

ODD = ("pipe", "device", "huge", "folder", "nothing")


def odd(folder: Path, kind: str, name: str = "odd") -> Path:
    """Create a path of a kind; the huge file takes no space on the disk."""
    path = folder / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "huge":
        with path.open("wb") as file:
            file.truncate(2**43)
    elif kind == "folder":
        path.mkdir()
    return path


@pytest.mark.parametrize("kind", ODD)
def test_what_cannot_be_read_whole_is_refused_at_once(tmp_path, kind) -> None:
    path = odd(tmp_path, kind)
    for read in (read_bytes, check_file):
        with pytest.raises(OSError, match=r"regular|larger than|No such") as error:
            read(path)
        assert error.value.filename in (str(path), path)


def test_a_file_is_read_up_to_its_limit(tmp_path) -> None:
    path = tmp_path / "some"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    for read in (read_bytes, check_file):
        with pytest.raises(OSError, match="larger than"):
            read(path, 4)


def test_only_a_file_with_all_of_the_bytes_has_the_content(tmp_path) -> None:
    path = tmp_path / "some"
    path.write_bytes(b"12345")
    assert has_content(path, b"12345")
    assert not any(has_content(path, other) for other in (b"", b"1234", b"12346", b"123456"))


@pytest.mark.parametrize("kind", ODD)
def test_what_cannot_be_read_has_no_content(tmp_path, kind) -> None:
    assert not has_content(odd(tmp_path, kind), b"")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "b": {"c": 1, "c": 2}}', "'c' is given twice"),
        ("[" * 100_000, "nested too deeply"),
        ("{", "line 1"),
    ],
)
def test_json_is_refused_in_words(text, words) -> None:
    with pytest.raises(ValueError, match=words):
        parse_json(text)
    assert parse_json(b'{"a": [1, {"a": 2}]}') == {"a": [1, {"a": 2}]}
