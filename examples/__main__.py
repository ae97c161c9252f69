"""`python -m examples [NAME …]`: every example and client runs a little, as a user would run it; a table of what came.

Each runs in a process of its own, in a temporary folder. Exit code 1 if one fails, or needs a package that is not here.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from quad_env.cli.command_line import UsageError, parse
from quad_env.cli.launcher import launch
from quad_env.cli.program import exit_code

FOLDER = Path(__file__).parent
LONGEST = 600.0
"""Time that one may take, s."""


@dataclass(frozen=True)
class Example:
    """A file that is run with few steps."""

    shows: str
    """What it does, for the table."""
    packages: tuple[str, ...] = ()
    """Distributions that it needs beside those of the environment itself."""
    little: str = ""
    """Its options for a short run."""
    after: str = ""
    """The example whose files it reads."""
    folder: str = "."

    def missing(self) -> list[str]:
        """Those of its packages that are not here."""
        return [name for name in self.packages if not version_of(name)]

    def run(self, name: str, where: Path) -> subprocess.CompletedProcess[str]:
        """Run it in that folder."""
        command = [sys.executable, str(FOLDER / self.folder / f"{name}.py"), *self.little.split()]
        return subprocess.run(command, cwd=where, capture_output=True, text=True, check=False, timeout=LONGEST)


SB3, TORCH = "stable-baselines3", "torch"
CLIENTS = "clients"
EXAMPLES = {
    "own_policy": Example("a policy of one's own, judged beside others", little="--episodes 2"),
    "read_parquet": Example("every episode as a row", little="results/own-policy", after="own_policy"),
    "combined_scenario": Example("several disturbances at once", little="--robots 4 --seconds 1"),
    "record_video": Example("RecordVideo: an episode as .mp4", ("moviepy",), "--steps 30"),
    "sb3_home_pose": Example("PPO about the home pose, judged", (SB3,), "--steps 1000 --episodes 1"),
    "sb3_batch": Example("PPO on the native batch", (SB3,), "--steps 1000 --robots 16"),
    "rsl_rl_batch": Example(
        "PPO on the native batch, to ONNX", ("rsl-rl-lib", "onnxscript"), "--iterations 3 --robots 16"
    ),
    "cleanrl_loop": Example("PPO in one loop on the native batch", (TORCH,), "--steps 4000"),
    "residual_ppo": Example("another learner of a residual, judged", (TORCH,), "--steps 1000 --envs 8"),
    "sb3_contrib_learners": Example("TQC, CrossQ, RecurrentPPO", ("sb3-contrib",), "--steps 300", folder=CLIENTS),
    "gymnasium_wrappers": Example(
        "wrappers of one and of a batch, vector environments", ("gymnasium",), folder=CLIENTS
    ),
    "minari_dataset": Example("a dataset, and its environment again", ("minari", "jax", "h5py"), folder=CLIENTS),
    "torchrl_collector": Example("three environments, PPO's loss", ("torchrl",), folder=CLIENTS),
    "rllib_ppo": Example("PPO on the native batch", ("ray", "dm-tree"), folder=CLIENTS),
}
"""By name, in the order in which they run."""


@dataclass(frozen=True)
class Options:
    """Which ones; all of them by default."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Files of examples/ and examples/clients/, without .py."""


def version_of(package: str) -> str:
    """The version that is installed; nothing of what is not here."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def chosen(names: Sequence[str]) -> list[str]:
    """The examples of these names, and before each the one that it comes after. Raises UsageError for other names."""
    if unknown := [name for name in names if name not in EXAMPLES]:
        raise UsageError(f"there is no example {unknown[0]!r}; there are {', '.join(EXAMPLES)}")
    wanted = set(names or EXAMPLES) | {EXAMPLES[name].after for name in names}
    return [name for name in EXAMPLES if name in wanted]


def main(words: Sequence[str] | None = None) -> int:
    """Run them one by one; the exit code."""
    return exit_code(lambda: _main(sys.argv[1:] if words is None else list(words)))


def _main(words: list[str]) -> int:
    names = chosen(parse(Options, words, program="python -m examples", description=__doc__ or "").names)
    rows, failed = Table("example", "with", "what it does", "seconds", "", title="Examples and clients"), 0
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            begin = time.perf_counter()
            failure, told = _tried(name, Path(folder))
            failed += bool(failure)
            packages = [f"{each} {version_of(each)}" for each in EXAMPLES[name].packages if version_of(each)]
            seconds = f"{time.perf_counter() - begin:.0f}"
            rows.add_row(name, ", ".join(packages), EXAMPLES[name].shows, seconds, escape(failure) or "ok")
            print(f"{name}: {failure or 'ok'} ({seconds} s)", *told, sep="\n  ", flush=True)
    Console().print(rows)
    return min(failed, 1)


def _tried(name: str, where: Path) -> tuple[str, list[str]]:
    """Why it does not run, nothing if it does, and the last lines of what it printed."""
    if missing := EXAMPLES[name].missing():
        return f'needs {", ".join(missing)}: pip install -e ".[clients]"', []
    try:
        run = EXAMPLES[name].run(name, where)
    except subprocess.TimeoutExpired:
        return f"still running after {LONGEST:g} s", []
    if run.returncode:
        return f"failed, exit code {run.returncode}", run.stderr.splitlines()[-20:]
    return "", run.stdout.strip().splitlines()[-1:]


if __name__ == "__main__":
    raise SystemExit(launch(main))
