"""Report of made-up episodes with every section that has numbers."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from evaluate.analysis.results import analyse, null_to_nan, write_json
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.catalogue import OF_CAUSES
from evaluate.measures.metrics import MEASURE_NAMES, Measures
from evaluate.report.page import write_report
from evaluate.rollouts.battery import resolve
from quad_env.scenarios.registry import Scenario

POLICIES = ("trot", "stand-in", "runs/x/seed-0", "runs/x/seed-1")
SCENARIOS = ("flat", "push:1", "push:2", "push:3", "rough")
EPISODES = 12


def watch_clipping(patch: pytest.MonkeyPatch) -> list[str]:
    """Return a list for all figures saved from now on: the number of figures, then the parts outside their figure."""
    seen = ["0"]
    save = Figure.savefig

    def look(figure: Figure, *args, **settings) -> None:
        FigureCanvasAgg(figure)
        figure.draw_without_rendering()
        box = figure.get_tightbbox()
        beyond = np.maximum(0.0, [-box.x0, -box.y0, *(np.array([box.x1, box.y1]) - figure.get_size_inches())])
        if beyond.max() > 0.005:
            labels = [f"{axes.get_title('left')} {axes.get_xlabel()} {axes.get_ylabel()}" for axes in figure.axes]
            seen.append(f"{'; '.join(labels)}: {beyond.round(3)} in")
        seen[0] = str(int(seen[0]) + 1)
        save(figure, *args, **settings)

    patch.setattr(Figure, "savefig", look)
    return seen


def measured(generator: np.random.Generator, successes: int, falls: int) -> Measures:
    """Return random measures of episodes; no two values are equal."""
    names = [name for name in MEASURE_NAMES if name not in OF_CAUSES]
    drawn = {name: generator.uniform(0.1, 1.9, EPISODES) for name in names}
    drawn |= dict.fromkeys(OF_CAUSES, np.full(EPISODES, None, dtype=object)) | {"cause_time": np.full(EPISODES, np.nan)}
    drawn["distance"] = drawn["distance"] + 2.0  # enough distance for a cost of transport
    order = generator.permutation(EPISODES)
    fell, succeeded = order < falls, order >= EPISODES - successes
    shapes = {"commands": (4, 3), "mean_velocities": (4, 3), "duty_factor": (4,)}
    drawn |= {name: generator.uniform(-1.0, 1.0, (EPISODES, *shape)) for name, shape in shapes.items()}
    pushes = {name: generator.uniform(0.1, 1.9, (EPISODES, 2)) for name in drawn if name.startswith("push_")}
    impulses = generator.uniform(-40.0, 40.0, (EPISODES, 2, 2))
    return Measures(
        **drawn
        | pushes
        | {
            "push_impulse": impulses,
            "push_fell": np.tile(fell[:, None], 2).astype(float),
            "outcome": np.where(fell, "fell", np.where(succeeded, "succeeded", "off_command")).astype(object),
            "fell": fell,
            "diverged": fell & (order == 0),
            "fall_time": np.where(fell, generator.uniform(1.0, 9.0, EPISODES), np.nan),
        }
    )


def cell_of(policy: str, scenario: Scenario, generator: np.random.Generator) -> PolicyScenarioResult:
    """Return a cell; a policy later in POLICIES breaks earlier on push."""
    place = POLICIES.index(policy)
    measures = measured(generator, *{"push:1": (11, 1), "push:3": (2, 10)}.get(scenario.name, (8 - place, 3 + place)))
    unfailing = np.full(EPISODES, None, dtype=object)
    return PolicyScenarioResult(
        policy, scenario, np.arange(EPISODES), np.where(measures.fell, "tilt", None), measures, unfailing
    )


@dataclass(frozen=True)
class Files:
    """Files of a comparison in its folder."""

    folder: Path
    clipped: list[str]

    @property
    def page(self) -> str:
        return (self.folder / "report.html").read_text(encoding="utf-8")

    @property
    def results(self) -> dict[str, Any]:
        """Return the results, with NaN for null."""
        found: dict[str, Any] = null_to_nan(json.loads((self.folder / "results.json").read_text(encoding="utf-8")))
        return found


@pytest.fixture(scope="session")
def four(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return four policies with the files that the command writes."""
    folder, generator = tmp_path_factory.mktemp("four"), np.random.default_rng(0)
    cells = [cell_of(policy, scenario, generator) for scenario in resolve(SCENARIOS) for policy in POLICIES]
    results = analyse(cells, seed=0, episodes=EPISODES, complete=True)
    write_json(results, folder / "results.json")
    with pytest.MonkeyPatch.context() as patch:
        clipped = watch_clipping(patch)
        write_report(results, folder / "report.html")
    return Files(folder, clipped)
