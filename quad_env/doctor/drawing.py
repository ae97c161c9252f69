"""Whether pictures of the robot can be drawn.

`python -m quad_env.doctor.drawing` draws one: a program of its own, since a broken OpenGL may end a whole process.
"""

import os
import signal
import subprocess
import sys

from quad_env.doctor.check import Finding, Subject, ok, problem

PATIENCE = 60.0
"""Longest time for a first frame, with shaders that the processor compiles, s."""
INSTALL = "install EGL (Debian and Ubuntu: apt install libegl1 libgl1 libgl1-mesa-dri)"


def opengl(_: Subject) -> Finding:
    """Draw a frame in another process."""
    command = (sys.executable, "-m", "quad_env.doctor.drawing")
    path = os.pathsep.join(filter(None, sys.path))
    try:
        run = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
            timeout=PATIENCE,
            env={**os.environ, "PYTHONPATH": path},
        )
    except subprocess.TimeoutExpired:
        return _broken(f"no frame within {PATIENCE:g} s")
    if run.returncode == 0:
        return ok(f"a frame is drawn, by {run.stdout.strip()}")
    if run.returncode < 0:
        return _broken(f"drawing ends the process ({signal.Signals(-run.returncode).name})")
    errors = [line for line in run.stderr.splitlines() if line and not line[0].isspace() and "Error" in line]
    last = (errors or run.stderr.strip().splitlines() or [f"exit code {run.returncode}"])[-1]
    return _broken(last.partition(". ")[0])


def _broken(seen: str) -> Finding:
    chosen, display = os.environ.get("MUJOCO_GL"), os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    seen = f"no picture can be drawn: {seen}"
    if sys.platform != "linux":
        return problem(seen, "the system gives no OpenGL", "run it in a desktop session, with its graphics driver")
    cause = "EGL or a driver behind it is missing"
    if chosen and chosen != "egl":
        cause = f"MUJOCO_GL={chosen} asks for a backend that does not work here"
    elif display and not chosen:
        cause = f"the display {display} gives no OpenGL"
    return problem(seen, cause, f"MUJOCO_GL=egl, which draws without a display; {INSTALL}")


def main() -> int:
    """Draw a frame and print the backend; the exit code, 0 where the frame shows something."""
    from quad_env.envs.env import SimpleQuadEnv

    env = SimpleQuadEnv(render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    frame = env.render()
    env.close()
    print(os.environ.get("MUJOCO_GL", "the display's own backend"))
    if frame is None or frame.std() < 1.0:
        print("Error: the frame is empty", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
