"""One point of growth, a process: `python -m benchmarks.probes.growth_probe envs|episodes COUNT THREADS STEPS`.

Prints seconds, what was done in them, and the largest memory that the process has ever held, as JSON.
"""

import json
import resource
import sys
import time
from pathlib import Path

import gymnasium as gym

import policies
from evaluate.rollouts.experiment import LabelledPolicy, Settings, evaluation_seeds, run_cell
from quad_env import ENV_ID, SCENARIOS

WARM_UP = 3
"""Control steps before the clock starts."""


def envs(count: int, threads: int, steps: int) -> tuple[float, int]:
    """Seconds and environment steps of a batch under the trot."""
    env, policy = gym.make_vec(ENV_ID, count, nthread=threads), policies.make("trot")
    observation, _ = env.reset(seed=0)
    policy.reset(count)
    for step in range(WARM_UP + steps):
        if step == WARM_UP:
            begin = time.perf_counter()
        observation, *_ = env.step(policy.act(observation))
    return time.perf_counter() - begin, count * steps


def episodes(count: int, threads: int, steps: int) -> tuple[float, int]:
    """Seconds and episodes of the trot's evaluation on flat ground; episodes have their own length."""
    trot = LabelledPolicy("trot", policies.make("trot"))
    begin = time.perf_counter()
    run_cell(trot, SCENARIOS["flat"], evaluation_seeds(0, count), Settings(threads, lambda *_: None))
    return time.perf_counter() - begin, count


KINDS = {"envs": envs, "episodes": episodes}


def main(kind: str, count: int, threads: int, steps: int) -> None:
    """Print the figures of one point."""
    seconds, done = KINDS[kind](count, threads, steps)
    print(json.dumps({"seconds": seconds, "done": done, "peak_bytes": peak_bytes()}))


def peak_bytes() -> int:
    """Largest resident memory of this process.

    Linux counts in `ru_maxrss` what the parent held when it forked, so there the kernel's own peak of this program.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
