"""Fit of the fall predictor: `python -m train search fall-prediction` writes policies/safety/prediction.json.

The threshold is what undisturbed walking stays below, by a margin. All episodes are of the "search" family of seeds.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.progress import Progress

import policies
from evaluate.rollouts.observers import Observer, Step
from evaluate.rollouts.rollout import STEPS, roll_out
from policies.base import CONTROL_PERIOD, Policy
from policies.parameters import number
from policies.safety.fall_prediction import THRESHOLD_FILE, next_recent, next_reference, velocity_deviation
from quad_env.cli.command_line import UsageError
from quad_env.seeding import episode_seeds
from train.search.outcome import check, save

MARGIN = 0.2
"""Between the threshold and the largest velocity deviation that undisturbed walking gave, m/s."""
AT_ONCE = 512
"""Episodes simulated side by side."""


@dataclass(frozen=True)
class Options:
    """Fit the fall predictor."""

    policies: tuple[str, ...] = ("trot",)
    """Policies that must not cause alarms: names, or files, as of python -m evaluate."""
    trust: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load policies from files in which code can be hidden, the .zip files of Stable-Baselines3."""
    hours: float = number(1.0, limits=(0.001, 1000.0))
    """Undisturbed walking of each policy."""
    seed: int = number(0, limits=(0, 2**31))
    """Seed of the episodes."""
    out: Path = THRESHOLD_FILE
    """JSON to write."""


def main(options: Options) -> int:
    """Fit and write; the exit code. Raises UsageError."""
    if not options.policies:
        raise UsageError("--policies must name at least one policy")
    check(options, options.out)
    episodes = max(1, round(options.hours * 3600 / (STEPS * CONTROL_PERIOD)))
    seeds = episode_seeds("search", options.seed * 100 + 50, episodes)
    chunks = np.array_split(seeds, -(-len(seeds) // AT_ONCE))
    with Progress() as progress:
        task = progress.add_task("walking", total=len(options.policies) * len(chunks) * STEPS)
        largest = max(
            undisturbed(policies.resolve(name, trust=options.trust), chunk, lambda _: progress.advance(task))
            for name in options.policies
            for chunk in chunks
        )
    save(options.out, json.dumps({"velocity_deviation": round(largest + MARGIN, 4)}, indent=2) + "\n")
    print(f"largest in {len(seeds) * STEPS * CONTROL_PERIOD / 3600:.2f} h: {largest:.3f} m/s; {options.out}")
    return 0


def undisturbed(policy: Policy, seeds: NDArray[np.int64], *observers: Observer) -> float:
    """The largest velocity deviation in undisturbed walking on flat ground, m/s."""
    reference, recent, largest = np.zeros((len(seeds), 2)), np.zeros((len(seeds), 2)), 0.0

    def watch(step: Step) -> None:
        nonlocal reference, recent, largest
        if step.number:
            reference = next_reference(reference, step.observation, step.env.dt)
            largest = max(largest, float(velocity_deviation(step.observation, reference, recent).max()))
            recent = next_recent(recent, step.observation, step.env.dt)

    roll_out(policy, "flat", seeds, watch, *observers)
    return largest
