"""Checks of the installation for the command `doctor`: packages, MuJoCo, and rendering with OpenGL."""

import contextlib
import os
import platform
import subprocess
import sys
from importlib import import_module, metadata

from packaging.requirements import Requirement

from quad_env.cli.child_process import RunClock
from quad_env.cli.launcher import HAS_BENCH
from quad_env.doctor.check import DoctorSubject, Finding, ok, problem

PROJECT = "simple-quad"
"""Name of the distribution of this project in the package index."""
REQUIRED_EXTRAS = {False: ("commands",), True: ("commands", "bench")}
"""Extras of PROJECT that must be installed: for `quad_env` alone, and for all packages of the project."""
RENDER_TIMEOUT = 60.0
"""Time after which a subprocess that has not yet drawn one frame is stopped, s.

The time is long enough for software rendering, which compiles the shaders on the processor. The time in which other
programs used the processor is not counted, see `RunClock`.
"""
EGL_REMEDY = "install EGL (Debian and Ubuntu: apt install libegl1 libgl1 libgl1-mesa-dri)"
DRAWING_PROGRAM = """
from quad_env.envs.env import SimpleQuadEnv
env = SimpleQuadEnv(render_mode="rgb_array", width=64, height=48)
env.reset(seed=0)
if env.render().std() < 1.0:
    raise SystemExit("Error: the frame is empty")
env.close()
"""
"""Source code of a Python program that draws one image of the robot with OpenGL.

The program runs in a subprocess, because a broken OpenGL can crash the process.
"""


def packages(_: DoctorSubject) -> Finding:
    """Check that all required packages are installed, in versions that the project supports."""
    extras = ("", *REQUIRED_EXTRAS[HAS_BENCH])
    requirements = map(Requirement, metadata.requires(PROJECT) or ())
    needed = {
        each.name: each
        for each in requirements
        if not each.marker or any(each.marker.evaluate({"extra": extra}) for extra in extras)
    }
    if faults := [fault for each in needed.values() if (fault := _fault(each))]:
        cause = "not installed into this environment, or changed by another package"
        project = f"{PROJECT}-bench" if HAS_BENCH else PROJECT
        return problem("; ".join(faults), cause, f"pip install -U {project}, or pip install -U -e . in a clone")
    return ok(f"Python {platform.python_version()}, {len(needed)} packages, MuJoCo {metadata.version('mujoco')}")


def _fault(needed: Requirement) -> str | None:
    """Return a text about the fault of the `needed` package; None if a valid version is installed."""
    try:
        version = metadata.version(needed.name)
    except metadata.PackageNotFoundError:
        return f"{needed.name} is missing"
    if needed.specifier.contains(version, prereleases=True):
        return None
    return f"{needed.name} is {version}, {needed.specifier} is required"


def mujoco(_: DoctorSubject) -> Finding:
    """Check that MuJoCo can be imported, including its functions that simulate many robots in one batch."""
    try:
        import_module("quad_env.physics.simulation")  # This module imports the parts of MuJoCo that all commands use.
    except Exception as error:  # OpenGL backends and system libraries can raise any exception.
        observed = f"MuJoCo does not load: {' '.join(str(error).split())}"
        if chosen := os.environ.get("MUJOCO_GL"):
            cause = f"MUJOCO_GL={chosen}, which MuJoCo reads as it loads, asks for what is not here"
            return problem(observed, cause, "unset MUJOCO_GL, or set it to egl")
        return problem(
            observed, "its wheel is for another system, or is damaged", "pip install --force-reinstall mujoco"
        )
    return ok("MuJoCo loads, with its batch")


def opengl(_: DoctorSubject) -> Finding:
    """Check that a subprocess can draw one image of the robot with OpenGL."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = sys.executable, "-c", DRAWING_PROGRAM
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment) as run:
        stderr = _stderr_in_time(run)
    if stderr is None:
        observed = f"no frame within {RENDER_TIMEOUT:g} s, without the time in which other programs had the processor"
        return problem(
            observed, "OpenGL, or a driver behind it, waits for ever", "see what `MUJOCO_GL=egl` gives, or osmesa"
        )
    if run.returncode == 0:
        return ok("a frame is drawn")
    lines = stderr.decode(errors="replace").splitlines()
    errors = [line for line in lines if line and not line[0].isspace() and "Error" in line]
    return _drawing_problem((errors or [f"drawing ends the process with {run.returncode}"])[-1].partition(". ")[0])


def _stderr_in_time(run: "subprocess.Popen[bytes]") -> bytes | None:
    """Wait for the end of the subprocess `run`, and return its standard error as bytes.

    If the subprocess has not ended after the run time RENDER_TIMEOUT, it is killed, and None is returned.
    """
    clock = RunClock(run.pid)
    while clock.elapsed() < RENDER_TIMEOUT:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return run.communicate(timeout=0.5)[1]
    run.kill()
    return None


def _drawing_problem(error: str) -> Finding:
    """Return the finding for a subprocess that could not draw an image; `error` is its last error line."""
    if sys.platform != "linux":
        return problem(error, "the system gives no OpenGL", "run it in a desktop session, with its graphics driver")
    cause = "EGL, the display or a driver behind it is missing"
    if chosen := os.environ.get("MUJOCO_GL"):
        cause = f"MUJOCO_GL={chosen} asks for a backend that does not work here"
    return problem(f"no picture can be drawn: {error}", cause, f"MUJOCO_GL=egl draws without a display; {EGL_REMEDY}")
