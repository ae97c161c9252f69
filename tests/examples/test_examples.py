"""Every example runs as for a user, with few steps, and prints the expected text."""

import contextlib
import re
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.seams import short_episodes, without_report

FOLDER = Path(__file__).parents[2] / "examples"
FILES = {path.stem: path for path in FOLDER.rglob("*.py") if path.stem != "__init__"}


class Run(NamedTuple):
    """A short run of an example."""

    options: str
    prints: str
    """Regular expression for a part of the printed text."""
    packages: str = ""
    """Packages that the example needs and that the installation of the tests may lack."""


RUNS = {
    "own_policy": Run("--episodes 1", r"ShortTrot.* trot +100\s%.* stand +0\s%.*episodes\.parquet"),
    "read_parquet": Run("results/own-policy", r"stand +flat +0% of 1, 0\.\d+ m/s off"),
    "combined_scenario": Run(
        "--robots 4 --seconds 1", r"flat: 0\.\d\d m/s of 0\.50 m/s, 0 of 4 fell\s+hillside: 0\.\d\d m/s"
    ),
    "batch_reward": Run(
        "--robots 4 --steps 60",
        r"flat: reward -?\d\.\d+ a step, -0\.0*[1-9]\d* of it for clearance\s+rough: reward -?\d\.\d+ a step, -0\.",
    ),
    "record_video": Run("--steps 30", r"trot-episode-0\.mp4: 0\.\d\d m/s forward", "moviepy"),
    "sb3_home_pose": Run(
        "--steps 1000 --episodes 1", r"saved .*sb3_home_pose\.zip after 1024 steps.* stand +0\s%.*report\.html"
    ),
    "sb3_batch": Run("--steps 1000 --robots 16", r"saved .*sb3_batch\.zip after 1024 steps"),
    "rsl_rl_batch": Run(
        "--iterations 3 --robots 16", r"saved .*policy\.onnx after 1152 steps", "rsl_rl onnxscript tensordict"
    ),
    "cleanrl_loop": Run("--steps 2048", r"2,048 steps  reward -?0\.\d+ a step"),
    "sb3_contrib_learners": Run(
        "--steps 300", r"TQC: 300 steps, 3 episodes earned.*CrossQ: 300 steps.*RecurrentPPO: 384 steps", "sb3_contrib"
    ),
    "gymnasium_wrappers": Run("", r"async: (\S+)\n.*, sync: \1\n.*, vector_entry_point: \1\n"),
    "minari_dataset": Run("", r"300 steps in 3 episodes on payload=5\+slope=8, \d fell; made again", "minari jax h5py"),
    "torchrl_collector": Run("", r"torch\.Size\(\[8\]\): .*256 frames.*256 frames", "torchrl"),
    "rllib_ppo": Run("", r"512\.0 steps.*on SimpleQuadVectorEnv", "ray tree"),
}


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of all examples, because `read_parquet` reads the results of `own_policy`."""
    return tmp_path_factory.mktemp("examples")


@pytest.mark.parametrize("name", RUNS)
def test_it_runs_as_its_first_lines_say(name: str, where: Path, monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    file, short = FILES[name], RUNS[name]
    if missing := [package for package in short.packages.split() if find_spec(package) is None]:
        pytest.skip(f'needs {", ".join(missing)}: pip install -e ".[clients]"')
    if file.parent.name == "clients":  # clients start processes, and some of them warn
        command = [sys.executable, str(file), *short.options.split()]
        run = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False, timeout=600)
        assert run.returncode == 0, run.stderr
        printed = run.stdout
    else:
        monkeypatch.chdir(where)
        monkeypatch.setattr(sys, "argv", [str(file), *short.options.split()])
        short_episodes(monkeypatch, 300)
        without_report(monkeypatch)  # the report has 30 plots
        with contextlib.suppress(SystemExit):
            runpy.run_path(str(file), run_name="__main__")
        printed = capfd.readouterr().out
    assert re.search(short.prints, printed, re.DOTALL), printed


def test_every_file_is_run_and_listed() -> None:
    assert set(FILES) == {*RUNS, "residual_ppo"}  # a complete learner, with its own tests
    rows = re.findall(r"^\| \[[\w/]+\.py\]\(([^)]+)\) \|", (FOLDER / "README.md").read_text("utf-8"), re.MULTILINE)
    assert sorted(FOLDER / link for link in rows) == sorted(FILES.values())
