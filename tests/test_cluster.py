"""The scripts of docs/cluster.md run: as SLURM arrays where a SLURM controller answers, else one task after another."""

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import LONGEST
from tests.test_docs import PAGES, ROOT, blocks

SCRIPTS = [block for block in blocks("bash", PAGES["docs/cluster.md"]) if block.startswith("#!/bin/bash\n")]
RUN = ("--policies", "stand", "document@flat", "--scenarios", "flat", "push", "--episodes", "2")
TRAINING = (
    "--steps 64 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat --max-episode-steps 8 "
    "--ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 4 --ppo.critic 4"
)
ENVIRONMENT = os.environ | {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "PYTHONPATH": str(ROOT),
}

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="the scripts are for bash")


@cache
def has_slurm() -> bool:
    """Return True if `sbatch` is there and a controller answers."""
    if shutil.which("sbatch") is None:
        return False
    return subprocess.run(["sinfo"], capture_output=True, check=False).returncode == 0


def run(*command: object, folder: Path, **variables: str) -> None:
    """Run a command in a folder with further environment variables; it must succeed."""
    words = [str(word) for word in command]
    finished = subprocess.run(
        words, cwd=folder, env=ENVIRONMENT | variables, capture_output=True, text=True, check=False, timeout=LONGEST
    )
    logs = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.log"))
    assert finished.returncode == 0, finished.stdout + finished.stderr + logs


def submit(script: Path, tasks: int, parts: int, *words: str) -> None:
    """Run the first tasks of an array of which the script has `parts` parts."""
    folder = script.parent
    if has_slurm():
        options = ("--wait", f"--array=1-{tasks}", "--cpus-per-task=1", "--mem=0")
        run("sbatch", *options, script.name, *words, folder=folder, PARTS=str(parts))
        return
    for task in range(1, tasks + 1):
        variables = {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_CPUS_PER_TASK": "1", "PARTS": str(parts)}
        run("bash", script.name, *words, folder=folder, **variables)


def write_script(index: int, path: Path) -> Path:
    """Write one of the two scripts of the page into a file."""
    path.write_text(SCRIPTS[index], encoding="utf-8")
    return path


def test_the_evaluation_of_an_array_is_that_of_one_command_and_no_part_runs_twice(tmp_path: Path) -> None:
    script = write_script(0, tmp_path / "job.sh")
    assert len(script.read_text(encoding="utf-8").splitlines()) == 10
    submit(script, 2, 2, *RUN)
    episodes = tmp_path / "parts/1/episodes.parquet"
    written = episodes.stat().st_mtime_ns
    submit(script, 1, 2, *RUN)
    assert episodes.stat().st_mtime_ns == written
    evaluate = (sys.executable, "-m", "evaluate")
    run(*evaluate, "merge", *sorted((tmp_path / "parts").iterdir()), "--out", "all", folder=tmp_path)
    run(*evaluate, *RUN, "--threads", "1", "--out", "one", folder=tmp_path)
    assert (tmp_path / "all/episodes.parquet").read_bytes() == (tmp_path / "one/episodes.parquet").read_bytes()


def test_the_training_of_an_array_trains_its_seed(tmp_path: Path) -> None:
    script = write_script(1, tmp_path / "train.sh")
    submit(script, 1, 5, *TRAINING.split())
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["residual-0"]
