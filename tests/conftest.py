"""Configuration of all tests: headless rendering, and property tests that draw the same examples in every run."""

import contextlib
import ctypes.util
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The examples are equal on every machine; without a deadline, since a slow machine is no fault of the code.
settings.register_profile("simple_quad", derandomize=True, deadline=None, database=None)
settings.load_profile("simple_quad")

# A shell lets background jobs ignore Ctrl-C, which their children inherit; tests that send Ctrl-C need the default.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# MuJoCo chooses its OpenGL backend at import: this must come before the import of any test module.
if "MUJOCO_GL" not in os.environ and sys.platform == "linux":
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "osmesa"

LONGEST = 240.0
"""s. Longest duration of a command that a test runs, on a busy machine; the test fails then instead of waiting."""
RENDER_ONE_PIXEL = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
with mujoco.Renderer(model, 1, 1) as renderer:
    renderer.update_scene(data)
    renderer.render()
"""


def rendering_failure() -> str | None:
    """Return why rendering is impossible, or None.

    Another process renders, since a failing backend may abort its process.
    """
    probe = subprocess.run([sys.executable, "-c", RENDER_ONE_PIXEL], capture_output=True, text=True, check=False)
    if probe.returncode == 0:
        return None
    return (probe.stderr.strip().splitlines() or [f"exit code {probe.returncode}"])[-1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the tests marked `rendering` on a machine without an OpenGL backend."""
    marked = [item for item in items if item.get_closest_marker("rendering")]
    if marked and (failure := rendering_failure()):
        backend = os.environ.get("MUJOCO_GL", "glfw")
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=f"no OpenGL: MUJOCO_GL={backend}: {failure}"))


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the root of the clone."""
    return Path(__file__).parents[1]


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Any], None]]:
    """Return a function that adds an extension for one test."""
    from quad_env import extensions  # Packages are imported after the choice of the OpenGL backend.

    monkeypatch.setattr(extensions, "_added", [])

    def drop_caches() -> None:
        for drop in extensions._added_observers:
            drop()

    yield extensions.add_extension
    monkeypatch.undo()
    drop_caches()


@contextlib.contextmanager
def _running(command: list[str], longest: float = LONGEST, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Yield the process of a command with its outputs in pipes as text; see `running`."""
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process: subprocess.Popen[str] = subprocess.Popen(command, **pipes | options)
    limit = threading.Timer(longest, process.kill)
    limit.start()
    try:
        yield process
    finally:
        limit.cancel()
        process.kill()
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


@pytest.fixture(scope="session")
def running() -> Callable[..., contextlib.AbstractContextManager[subprocess.Popen[str]]]:
    """Return a function that runs a command as a context.

    The process is ended after `longest`, and whenever the test ends. A process that outlives its test would let another
    test fail when its pipes are collected.
    """
    return _running


@pytest.fixture
def display() -> Iterator[str]:
    """Yield the name of a virtual display; its server ends with the test."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writing)
    try:
        with os.fdopen(reading) as number:
            yield f":{number.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return a function that calls a program with arguments it refuses, and returns the one line that it prints."""

    def line(main: Callable[[list[str]], int], *words: object) -> str:
        assert main([str(word) for word in words]) == 2
        printed = capsys.readouterr()
        assert (printed.out, printed.err.count("\n")) == ("", 1), printed
        assert printed.err.startswith("error: ")
        return printed.err

    return line
