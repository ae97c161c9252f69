"""One small comparison, made by the command itself, that several test files look at."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from evaluate.__main__ import main


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
