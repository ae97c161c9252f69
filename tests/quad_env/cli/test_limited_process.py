"""Limited process for files of others: it returns an answer, an error, or one line within its time."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from quad_env.cli import limited_process
from quad_env.cli.child_process import RunClock
from quad_env.cli.limited_process import MEMORY, TIME, CrashError, LimitExceededError, call, read_limited
from quad_env.robots.structure import ModelError

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits time and memory so")


def answer(value: object) -> object:
    return value, os.getpid()


def fail(words: str) -> None:
    raise ModelError(words)


class Closed(Exception):
    """Object that cannot be pickled."""

    def __init__(self) -> None:
        super().__init__("closed")
        self.inner = lambda: None


def fail_closed() -> None:
    raise Closed


def work_for_ever(_: Path) -> None:
    while True:
        pass


def sleep_for_ever() -> None:
    time.sleep(1e6)


def allocate(mebibytes: int) -> int:
    return len(bytearray(mebibytes * 2**20))


def crash() -> None:
    import ctypes

    ctypes.string_at(0)


def leave() -> None:
    os._exit(3)


def shout() -> str:
    os.write(1, b"noise of a library")
    print("noise", flush=True)
    return "done"


def size(file: Path) -> tuple[int, int]:
    return len(file.read_bytes()), os.getpid()


def test_answers_and_errors_come_as_they_are_from_one_process_apart() -> None:
    (value, pid), (again, same) = call(answer, {"a": [1]}), call(answer, "b")  # type: ignore[misc]
    assert (value, again) == ({"a": [1]}, "b")
    assert pid == same != os.getpid()
    with pytest.raises(ModelError, match=r"^no robot$"):
        call(fail, "no robot")
    with pytest.raises(RuntimeError, match="Closed: closed"):
        call(fail_closed)
    assert call(shout) == "done"


@LINUX
def test_what_takes_too_long_ends_and_the_next_is_answered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(TIME, "1")
    for ask in (lambda: call(work_for_ever, tmp_path), lambda: call(sleep_for_ever)):
        with pytest.raises(LimitExceededError, match=f"more than 1 s of processor time; {TIME} raises the limit"):
            ask()
        assert call(answer, 1)[0] == 1  # type: ignore[index]


@LINUX
def test_what_takes_too_much_memory_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MEMORY, "100")
    assert call(allocate, 50) == 50 * 2**20
    with pytest.raises(LimitExceededError, match=f"more than 100 MiB of memory; {MEMORY} raises the limit"):
        call(allocate, 1000)
    monkeypatch.setenv(MEMORY, "2000")
    assert call(allocate, 1000) == 1000 * 2**20


@LINUX
@pytest.mark.parametrize(("function", "words"), [(crash, "SIGSEGV"), (leave, "exit code 3")])
def test_a_crash_is_one_line_here(function: object, words: str) -> None:
    with pytest.raises(CrashError, match=words):
        call(function)  # type: ignore[arg-type]


def test_a_file_is_read_apart_once_as_long_as_it_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(limited_process.READ_FILES, "")
    file = tmp_path / "a"
    file.write_text("abc")
    length, apart = read_limited(size, file)
    assert length == 3
    assert apart != os.getpid()
    assert read_limited(size, file) == (3, os.getpid())
    assert read_limited(size, file, again=False) is None
    file.write_text("abcd")
    assert read_limited(size, file)[1] != os.getpid()
    with pytest.raises(FileNotFoundError):
        read_limited(size, tmp_path / "none")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system forks no processes")
def test_a_forked_process_has_a_limited_process_of_its_own() -> None:
    code = """
import os
from tests.quad_env.cli.test_limited_process import answer
from quad_env.cli.limited_process import call
first = call(answer, 1)[1]
if not (child := os.fork()):
    print(call(answer, 2)[1] != first, flush=True)
    raise SystemExit
os.waitpid(child, 0)
print(call(answer, 3)[1] == first)
"""
    command = [sys.executable, "-W", "error", "-c", code]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120, env=environment)
    assert run.stdout.split() == ["True", "True"]
    assert run.stderr == ""


def test_where_no_process_can_be_started_it_is_called_here(monkeypatch: pytest.MonkeyPatch) -> None:
    limited_process.end_process()
    monkeypatch.setattr(sys, "executable", "/no/python")
    assert call(answer, 1) == (1, os.getpid())


@LINUX
def test_a_starved_process_has_its_time_and_a_sleeping_one_has_not() -> None:
    """On one core, which others keep busy, a working process gets a small share of the time."""
    core = min(os.sched_getaffinity(0))
    busy = [sys.executable, "-c", f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: pass"]
    processes = [subprocess.Popen(busy) for _ in range(5)]
    sleeping = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
    try:
        time.sleep(2.0)
        starved, asleep = RunClock(processes[0].pid), RunClock(sleeping.pid)
        began = time.monotonic()
        time.sleep(3.0)
        wall = time.monotonic() - began
        assert starved.elapsed() < 0.6 * wall
        assert asleep.elapsed() > 0.9 * wall
    finally:
        for process in (*processes, sleeping):
            process.kill()
            process.wait()


def content_of(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def test_a_relative_path_is_that_of_the_asking_process_wherever_it_has_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file.txt").write_text(name, encoding="utf-8")
        monkeypatch.chdir(tmp_path / name)
        assert call(content_of, Path("file.txt")) == name
