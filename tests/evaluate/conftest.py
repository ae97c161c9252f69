"""A small comparison, made by the command, that several test files use."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.analysis.results import Results, analyse
from evaluate.cells import PolicyScenarioResult
from evaluate.commands.options import EvaluateOptions
from evaluate.measures.metrics import MEASURE_NAMES, Measures
from evaluate.records.episode_table import write_parquet
from evaluate.records.manifest import Manifest
from evaluate.records.provenance import versions
from evaluate.rollouts.battery import resolve
from quad_env import SCENARIOS as NOMINAL
from quad_env import Scenario
from tests.seams import replace_simulation, without_report


@dataclass(frozen=True)
class Run:
    """Results folder of a command, its results, and its text on stderr."""

    folder: Path
    results: dict[str, Any]
    stderr: str


@pytest.fixture
def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the report, because its plots take seconds."""
    without_report(monkeypatch)


@pytest.fixture
def no_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every simulation fail: an error must be found before the simulation."""

    def simulated(*_args: Any, **_options: Any) -> None:
        raise AssertionError("an episode was simulated")

    replace_simulation(monkeypatch, simulated)


POLICIES = ("document", "stand", "trot")
SCENARIOS = ("flat", "push")
EPISODES = 5


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Run a comparison of three policies on two scenarios; one of the policies always falls."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("evaluation")
    stderr = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(stderr):
        arguments = ["--policies", *POLICIES, "--scenarios", *SCENARIOS, "--episodes", str(EPISODES)]
        code = main([*arguments, "--seed", "3", "--out", str(folder)])
    assert code == 0, stderr.getvalue()
    results = json.loads(folder.joinpath("results.json").read_text(encoding="utf-8"))
    return Run(folder, results, stderr.getvalue())


def outcomes(
    policy: str, fell, error=None, scenario: Scenario = NOMINAL["flat"], first_seed: int = 0
) -> PolicyScenarioResult:
    """Return episodes that fell or succeeded, with one error in every error metric; all other measures are missing."""
    fell = np.asarray(fell, bool)
    errors = np.zeros(len(fell)) if error is None else np.asarray(error, float)
    known = {"fell": fell, "velocity_error": errors, "yaw_rate_error": errors, "mean_velocity_error": errors}
    known |= {
        "outcome": np.where(fell, "fell", "succeeded").astype(object),
        "diverged": np.zeros(len(fell), bool),
        "commands": np.zeros((len(fell), 1, 3)),
    }
    known |= {"mean_velocities": known["commands"], "extra": {}}
    nothing = np.full(len(fell), np.nan)
    measures = Measures(**{name: known.get(name, nothing) for name in MEASURE_NAMES})
    reasons = np.full(len(fell), None, dtype=object)
    return PolicyScenarioResult(
        policy, scenario, np.arange(first_seed, first_seed + len(fell)), reasons, measures, reasons
    )


@pytest.fixture
def made_up_cell() -> Callable[..., PolicyScenarioResult]:
    """Return a function that makes a cell of given outcomes: policy, fell, error, scenario, first seed."""
    return outcomes


def fallen(policy: str, scenario: str, falls: int, error: Sequence[float]) -> PolicyScenarioResult:
    """Return episodes; the first `falls` of them fell after 2 s, and no robot was pushed."""
    count = len(error)
    fell = np.arange(count) < falls
    cell = outcomes(policy, fell, error, resolve((scenario,))[0])
    measures = dataclasses.replace(
        cell.measures,
        fall_time=np.where(fell, 2.0, np.nan),
        commands=np.full((count, 1, 3), np.nan),
        mean_velocities=np.full((count, 1, 3), np.nan),
        duty_factor=np.full((count, 4), np.nan),
        push_impulse=np.empty((count, 0, 2)),
        **dict.fromkeys(("push_time", "push_fell"), np.empty((count, 0))),
    )
    return dataclasses.replace(cell, fall_reason=np.where(fell, "tilt", None), measures=measures)


@pytest.fixture(scope="session")
def made() -> Results:
    """Return cells of two policies.

    `other` falls less than trot on three of four pushes, more on rough, never on flat.
    """
    falls = {
        "flat": (0, 0),
        "push:1": (0, 0),
        "push:3": (20, 2),
        "push:5": (34, 17),
        "push:6": (38, 28),
        "rough": (2, 22),
    }
    cells = [
        fallen(policy, scenario, count, 0.1 + 0.002 * np.arange(40) - 0.05 * (policy == "other"))
        for scenario, both in falls.items()
        for policy, count in zip(("trot", "other"), both, strict=True)
    ]
    return analyse(cells, seed=0, episodes=40, complete=True)


SPREAD = {"flat": 0, "push:1": 1, "push:3": 4, "push:5": 9, "slope:2": 3, "slope:4": 8, "flat+hardware": 6}
"""Scenario of a planted run -> falls of `trot`; the policies of the group fall more often, each by another number."""
MEMBERS = {"runs/mine/seed-0": 0, "runs/mine/seed-1": 2, "runs/mine/seed-2": 8}
"""Policy of the group `mine` of a planted run -> its further falls on every scenario."""


def planted_cells(episodes: int = 24) -> list[PolicyScenarioResult]:
    """Return episodes of `trot`, `stand` and three training seeds on seven scenarios, none of them simulated."""
    rng = np.random.default_rng(0)
    cells = []
    for scenario, falls in SPREAD.items():
        for policy, further in {"trot": 0, "stand": 14, **MEMBERS}.items():
            cell = fallen(policy, scenario, min(episodes, falls + further), rng.uniform(0.05, 0.3, episodes))
            energy = rng.uniform(200.0, 300.0, episodes) * (1.0 + 0.05 * further)
            measures = dataclasses.replace(cell.measures, energy=energy, distance=rng.uniform(4.0, 5.0, episodes))
            cells.append(dataclasses.replace(cell, measures=measures, seeds=np.arange(episodes)))
    return cells


def write_run(folder: Path, cells: Sequence[PolicyScenarioResult], groups: dict[str, list[str]]) -> Path:
    """Write the results folder of a finished run with these episodes, without report and results.json."""
    folder.mkdir()
    scenarios = dict.fromkeys(cell.scenario for cell in cells)
    labels = dict.fromkeys(cell.policy for cell in cells)
    manifest = Manifest(
        policies=dict.fromkeys(labels, "0" * 64),
        scenarios=tuple(scenarios),
        seed=0,
        episodes=cells[0].episodes,
        steps=1000,
        versions=versions(),
        code="",
        cpu="",
        options=EvaluateOptions().run_options(),
        threads=1,
        groups=groups,
    ).with_fingerprint()
    manifest.write(folder)
    write_parquet(cells, folder / "episodes.parquet", manifest.fingerprint)
    return folder


@pytest.fixture(scope="session")
def planted_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results folder of a finished run with a group `mine` of three training seeds."""
    return write_run(tmp_path_factory.mktemp("planted") / "run", planted_cells(), {"mine": [*MEMBERS]})
