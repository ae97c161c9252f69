"""One small comparison, made by the command itself, that several test files look at."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.experiment import Cell
from evaluate.metrics import Measures
from quad_env import SCENARIOS as NOMINAL
from quad_env import Scenario


@dataclass(frozen=True)
class Run:
    """What the command wrote and printed."""

    folder: Path
    results: dict[str, Any]
    stdout: str
    stderr: str


POLICIES = ("document", "stand", "trot")
SCENARIOS = ("flat", "push")
EPISODES = 5


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A comparison of three policies, one of which always falls, on two scenarios."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("evaluation")
    stdout, stderr = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
        arguments = ["--policies", *POLICIES, "--scenarios", *SCENARIOS, "--episodes", str(EPISODES)]
        code = main([*arguments, "--seed", "3", "--out", str(folder)])
    assert code == 0, stderr.getvalue()
    results = json.loads(folder.joinpath("results.json").read_text())
    return Run(folder, results, stdout.getvalue(), stderr.getvalue())


def outcomes(policy: str, fell, error=None, scenario: Scenario = NOMINAL["flat"], first_seed: int = 0) -> Cell:
    """Episodes that fell or not, with an error in every error metric; all other figures do not exist."""
    fell = np.asarray(fell, bool)
    errors = np.zeros(len(fell)) if error is None else np.asarray(error, float)
    known = {"fell": fell, "velocity_error": errors, "yaw_rate_error": errors, "mean_velocity_error": errors}
    known |= {"diverged": np.zeros(len(fell), bool), "commands": np.zeros((len(fell), 1, 3))}
    known["mean_velocities"] = known["commands"]
    nothing = np.full(len(fell), np.nan)
    measures = Measures(**{field.name: known.get(field.name, nothing) for field in dataclasses.fields(Measures)})
    reasons = np.full(len(fell), None, dtype=object)
    return Cell(policy, scenario, np.arange(first_seed, first_seed + len(fell)), reasons, measures)


@pytest.fixture
def made_up_cell() -> Callable[..., Cell]:
    """Makes a cell of outcomes that a test chooses: policy, fell, error, scenario, first seed."""
    return outcomes
