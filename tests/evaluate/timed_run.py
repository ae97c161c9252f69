"""Evaluations with a time limit, on a clock that only simulated episodes advance, so that their rounds are fixed."""

import contextlib
import io
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import main
from evaluate.commands import execution
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from evaluate.rollouts.rollout import ScenarioEpisodes
from evaluate.rollouts.time_limit import RoundPlanner
from policies.base import Policy
from tests.seams import replace_simulation, short_episodes, without_report

STEPS = 110
EPISODE_TIME = 1.0
"""Time by which a simulated episode of one policy advances the clock, s."""


class SimulatedClock:
    """Clock that only simulated episodes advance."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def install(self, patch: pytest.MonkeyPatch) -> None:
        """Let the planner of the rounds read this clock, and simulated episodes advance it."""
        simulate = rollout.run_scenarios

        def simulate_slowly(policy: Policy, batches: Sequence[ScenarioEpisodes], **settings: Any) -> list[Episodes]:
            self.now += EPISODE_TIME * sum(len(batch.seeds) for batch in batches)
            return simulate(policy, batches, **settings)

        replace_simulation(patch, simulate_slowly)
        patch.setattr(execution, "RoundPlanner", partial(RoundPlanner, clock=self))


def evaluate(*arguments: object) -> tuple[int, str]:
    """Return exit code and stderr of `python -m evaluate` with short episodes and without a report."""
    error = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(error),
    ):
        short_episodes(patch, STEPS)
        without_report(patch)
        code = main([str(argument) for argument in arguments])
    return code, error.getvalue()


def run_for(minutes: float, folder: Path, *words: str) -> tuple[SimulatedClock, str]:
    """Run an evaluation with a time limit, and return its clock and its text on stderr."""
    clock = SimulatedClock()
    with pytest.MonkeyPatch.context() as patch:
        clock.install(patch)
        code, said = evaluate(*words, "--minutes", minutes, "--threads", 1, "--out", folder)
    assert code == 0, said
    return clock, said


def episodes_by_cell(folder: Path) -> Counter[tuple[str, str]]:
    """Return the number of episodes of each policy on each scenario in a results folder."""
    rows = pq.read_table(folder / "episodes.parquet", columns=["policy", "scenario"]).to_pylist()
    return Counter((row["policy"], row["scenario"]) for row in rows)
