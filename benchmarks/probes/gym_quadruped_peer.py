"""gym-quadruped (PyPI) in a process of its own, under any interpreter that has it; it steps when it is told to.

This file run as a script is that process: it needs nothing of this project.
"""

import contextlib
import importlib
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

PROBE = "import gym_quadruped"
ROBOT = "go1"
STIFFNESS, DAMPING = 40.0, 1.0
"""N·m/rad and N·m·s/rad: joint torques that hold the robot's standing pose."""


def interpreter(given: Path | None) -> str | None:
    """The interpreter to use, or None if none was given and this one has no gym-quadruped. OSError if it has none."""
    python = str(given) if given else sys.executable
    has = subprocess.run([python, "-c", PROBE], capture_output=True, check=False).returncode == 0
    if given and not has:
        raise FileNotFoundError(f"--peer-python: {given} cannot import gym_quadruped")
    return python if has else None


class Peer:
    """The process, as two subjects: its environment and its robot in a bare loop."""

    def __init__(self, python: str, steps: int) -> None:
        command = [python, "-W", "ignore", str(Path(__file__).resolve()), str(steps)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def environment(self) -> float:
        """Seconds a physics step of its environment."""
        return self._ask("environment")

    def physics(self) -> float:
        """Seconds a physics step of its robot alone."""
        return self._ask("physics")

    def _ask(self, what: str) -> float:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            print(what, file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise OSError("gym-quadruped ended unexpectedly")
        return float(answer)


def serve(steps: int) -> None:
    """Answer each line of stdin with the seconds that a physics step took."""
    import mujoco

    environments: Any = importlib.import_module("gym_quadruped.quadruped_env")
    answers = sys.stdout
    with contextlib.redirect_stdout(sys.stderr):
        env = environments.QuadrupedEnv(robot=ROBOT, scene="flat", sim_dt=0.002)
        for line in sys.stdin:
            env.reset(random=False)
            stand = env.mjData.qpos[7:19].copy()
            if line.strip() == "environment":
                seconds = _run(env.step, env, stand, steps)
            else:
                seconds = _run(lambda torque: _bare(mujoco, env, torque), env, stand, steps)
            print(seconds / steps, file=answers, flush=True)


def _bare(mujoco: Any, env: Any, torque: Any) -> None:
    env.mjData.ctrl = torque
    mujoco.mj_step(env.mjModel, env.mjData)


def _run(step: Any, env: Any, stand: Any, steps: int) -> float:
    seconds = 0.0
    for _ in range(steps):
        torque = STIFFNESS * (stand - env.mjData.qpos[7:19]) - DAMPING * env.mjData.qvel[6:18]
        begin = time.perf_counter()
        step(torque)
        seconds += time.perf_counter() - begin
    return seconds


if __name__ == "__main__":
    serve(int(sys.argv[1]))
