"""Effort of walking with physics time steps of 2, 1 and 0.5 ms: `python -m research time-step`.

Each policy walks the same episodes with every time step. The table has the success rate, the cost of transport, and
other measures of effort and gait.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import policies
from evaluate.cells import evaluation_seeds
from evaluate.commands.options import WALKING_POLICIES
from evaluate.hardware import HardwareConfig
from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_all
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from quad_env.cli.command_line import check_numbers
from quad_env.config import TaskConfig
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from research.pages.csv_text import to_csv

STEPS = 0.002, 0.001, 0.0005
"""Compared physics time steps, s.

The first is the default time step, with which all other results of the project are computed.
"""
MEANS = (*(name for name in EFFORT if name != "cost_of_transport"), "mechanical_power", "mean_velocity_error")
"""Names of the effort and error measures that are averaged over the episodes.

The cost of transport is not among these measures, because it is computed from the energy and distance of all
episodes together.
"""


@dataclass(frozen=True)
class TimeStepOptions:
    """Options of the command `time-step`: policies, scenarios and episodes."""

    policies: tuple[str, ...] = ("document_repaired", *WALKING_POLICIES, "mpc_wbc")
    """Names or folders of the policies that are measured."""
    scenarios: tuple[str, ...] = ("steady", "flat")
    """Names of the scenarios."""
    episodes: int = 12
    """Number of episodes of each policy on each scenario with each physics time step."""
    table: Path = Path("results/time_step.csv")
    """CSV file for the results."""


@dataclass(frozen=True)
class _SteppedHardwareConfig(HardwareConfig):
    """Hardware settings with ideal motors and sensors, and with a given physics time step."""

    timestep: float = STEPS[0]
    """Physics time step of the simulation, s."""

    def env_kwargs(self, robot: Robot) -> dict[str, Any]:
        """Return the keyword arguments of the environment of `robot`, including the physics time step."""
        return super().env_kwargs(robot) | {"config": TaskConfig(timestep=self.timestep)}


def main(options: TimeStepOptions) -> int:
    """Run the command `time-step`: simulate the episodes, and print and write the results.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    check_numbers(options, {"episodes": (1, 4096)})
    table = list(measure_effort(options))
    write_atomically(options.table, to_csv(table))
    print(to_csv(table).decode(), options.table, sep="")
    return 0


def measure_effort(options: TimeStepOptions) -> Iterator[dict[str, Any]]:
    """Measure success, cost of transport and effort for each policy, scenario and physics time step.

    Args:
        options: Options of the command.

    Yields:
        Row of the table: name of the column -> value. A row has the success rate, the cost of transport of all episodes
        together, and the means of the other measures over the episodes.
    """
    seeds = evaluation_seeds(0, options.episodes)
    for scenario, name, step in product(options.scenarios, options.policies, STEPS):
        hardware = _SteppedHardwareConfig(timestep=step)
        episodes = rollout.run(policies.resolve(name, servo="own"), scenario, seeds, nthread=2, hardware=hardware)
        measures = measure(episodes)
        row = {"policy": name, "scenario": scenario, "step": step, "success_rate": float(measures.succeeded.mean())}
        row["cost_of_transport"] = cost_of_all(measures.energy, measures.distance, episodes.weight)
        yield row | {figure: float(np.nanmean(getattr(measures, figure))) for figure in MEANS}
