"""Dependence of effort on the physics' time step: `python -m research time-step` walks the same episodes at each."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import policies
from evaluate.measures.catalogue import EFFORT
from evaluate.measures.effort import cost_of_transport
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import evaluation_seeds
from evaluate.rollouts.hardware import Hardware
from quad_env.cli.command_line import check_numbers
from quad_env.cli.format import number
from quad_env.config import TaskConfig
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from research.pages.csv_text import csv_text

STEPS = 0.002, 0.001, 0.0005
"""s; the first is that of every result."""
MEANS = "energy", "positive_work", "regeneration", "distance", "mean_velocity_error"
"""Measures that are written next to the effort."""
HEADS = "cost_of_transport", "step_rate", "duty_factor", "flight", "trunk_height", "mean_velocity_error"
LIMITS = {"episodes": (1, 4096), "seed": (0, 2**63 - 1), "threads": (1, 256)}


@dataclass(frozen=True)
class Options:
    """Measure effort at time steps of 2, 1 and 0.5 ms."""

    policies: tuple[str, ...] = (
        *("document_repaired", "trot", "trot_feedback", "trot_integral", "residual", "robust", "mpc_wbc"),
    )
    """Names or folders of policies."""
    scenarios: tuple[str, ...] = ("steady", "flat")
    """Scenarios."""
    episodes: int = 12
    """Episodes of each policy on each scenario at each step (count)."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    threads: int = 2
    """Threads of the simulation."""
    table: Path | None = None
    """CSV file for the figures."""


@dataclass(frozen=True)
class _Stepped(Hardware):
    timestep: float = STEPS[0]

    def environment(self, robot: Robot) -> dict[str, Any]:
        return super().environment(robot) | {"config": TaskConfig(timestep=self.timestep)}


def main(options: Options) -> int:
    """Run and print, cost of transport first. Raises UsageError."""
    check_numbers(options, LIMITS)
    rows, table = [], Table("policy", "scenario", "step, ms", *HEADS)
    for row in figures(options):
        rows.append(row)
        table.add_row(row["policy"], row["scenario"], f"{1000 * row['timestep']:g}", *(number(row[n]) for n in HEADS))
    Console().print(table)
    if options.table is not None:
        write_atomically(options.table, csv_text(rows))
    return 0


def figures(options: Options) -> Iterator[dict[str, Any]]:
    """Effort of each policy on each scenario at each step: means of the episodes, cost of transport that of all."""
    seeds = evaluation_seeds(options.seed, options.episodes)
    for scenario, name, step in product(options.scenarios, options.policies, STEPS):
        policy = policies.resolve(name)
        record = rollout.run(policy, scenario, seeds, nthread=options.threads, hardware=_Stepped(timestep=step))
        found = measure(record)
        means = {each: float(np.nanmean(getattr(found, each))) for each in (*EFFORT, *MEANS)}
        transport = cost_of_transport(found.energy.sum(keepdims=True), found.distance.sum(keepdims=True), record.weight)
        row = {"policy": policy.name, "scenario": scenario, "timestep": step, "success_rate": found.succeeded.mean()}
        yield row | means | {"cost_of_transport": float(transport[0])}
