"""The gaits on flat ground: `python -m research gaits`.

Each gait at its speed: falls, and measured against commanded duty factors and phase offsets. Every change of gait while
walking, at a different time for each robot: falls, and the speed of the joint targets.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from evaluate.rollouts.observers import Step
from policies.base import CONTROL_PERIOD
from policies.gaits.parameters import GAITS, OFFSETS
from policies.gaits.policy import Gaits
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.seeding import episode_seeds
from research.studies.strides import TARGET_RATE_LIMIT, Strides, walked

SPEEDS = dict.fromkeys(OFFSETS, 0.5) | {"walk": 0.3, "stand": 0.0}
"""Forward command of each gait, m/s."""
SETTLING = 200
"""Control steps before a gait's contacts count."""
CHANGE = (200, 250)
"""Control steps within which the change of gait is asked for."""
CHANGE_STEPS = 600
"""Control steps of an episode with a change of gait."""

LIMITS = {"robots": (1, 65_536), "seconds": (3.0, 1000.0), "threads": (1, 256), "seed": (0, 2**31)}
"""Smallest and largest value of each number of the options."""


@dataclass(frozen=True)
class Options:
    """Measure the gaits."""

    gaits: tuple[str, ...] = GAITS
    """Names of gaits; changes are measured between all of them."""
    robots: int = 256
    """Robots a gait, and a change of gait (count)."""
    seconds: float = 10.0
    """Length of an episode without a change, s."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    threads: int = 2
    """Threads of the simulation (count)."""


def changes(first: str, others: tuple[str, ...], seeds: NDArray[np.int64], *, threads: int = 2) -> list[Strides]:
    """Each episode with `first` and then another gait, for each of the others; the speed is the slower gait's.

    Each robot changes at a control step of its own within CHANGE, and so anywhere in its cycle.
    """
    count = len(seeds)
    due = np.tile(np.linspace(*CHANGE, count, dtype=np.int64), len(others))
    goal = np.repeat(np.arange(len(others)), count)
    moving = [min(v for v in (SPEEDS[first], SPEEDS[other]) if v > 0.0) for other in others]
    command = np.zeros((len(goal), 3))
    command[:, 0] = np.repeat(moving, count)

    policy = Gaits(first)

    def change(step: Step) -> None:
        for number, other in enumerate(others):
            asked = (due == step.number) & (goal == number)
            if asked.any():
                policy.request(other, asked)

    found = walked(policy, command, np.tile(seeds, len(others)), change, steps=CHANGE_STEPS, nthread=threads)
    return [found.of(goal == number) for number in range(len(others))]


def _steady_table(options: Options) -> Table:
    table = Table(title=f"{options.robots} robots, {options.seconds:g} s", title_justify="left", title_style="bold")
    heads = ("m/s asked", "m/s", "Hz", "duty", "duty error", "phase error", "target rad/s", "falls")
    for head in ("gait", *heads):
        table.add_column(head, justify="left" if head == "gait" else "right")
    seeds = episode_seeds("evaluation", options.seed, options.robots)
    for gait in options.gaits:
        command, steps = np.array([SPEEDS[gait], 0.0, 0.0]), round(options.seconds / CONTROL_PERIOD)
        found = walked(Gaits(gait), command, seeds, steps=steps, nthread=options.threads)
        late = found.of(~found.fell).since(SETTLING)
        standing = gait not in OFFSETS
        errors = ("-", "-", "-", "-") if standing else (
            f"{late.clock_rate.mean():.2f}",
            f"{late.duty.mean():.3f}",
            f"{np.abs(late.duty_errors()).max():.3f}",
            f"{np.abs(late.offset_errors()).max():.3f}",
        )  # fmt: skip
        table.add_row(
            gait,
            f"{SPEEDS[gait]:g}",
            f"{late.heading_velocity[..., 0].mean():.2f}",
            *errors,
            f"{found.target_rate.max():.1f}",
            str(int(found.fell.sum())),
        )
    table.caption = "errors: of the worst foot of the worst robot; target: the fastest of all joints and steps"
    return table


def _change_table(options: Options) -> Table:
    table = Table(title=f"Changes, {options.robots} robots each", title_justify="left", title_style="bold")
    table.add_column("from \\ to")
    for gait in options.gaits:
        table.add_column(gait, justify="right")
    seeds = episode_seeds("evaluation", options.seed + 1, options.robots)
    for first in options.gaits:
        others = tuple(gait for gait in options.gaits if gait != first)
        found = dict(zip(others, changes(first, others, seeds, threads=options.threads), strict=True))
        cells = (
            f"{int(found[gait].fell.sum())}, {found[gait].target_rate.max():.1f}" if gait in found else "-"
            for gait in options.gaits
        )
        table.add_row(first, *cells)
    table.caption = f"falls, and the fastest target in rad/s; the limit is {TARGET_RATE_LIMIT:g} rad/s"
    return table


def main(options: Options) -> int:
    """Measure and print; the exit code."""
    if not options.gaits or set(options.gaits) - set(GAITS) or len(set(options.gaits)) < len(options.gaits):
        raise UsageError(f"--gaits: name each once; there are {', '.join(GAITS)}")
    check_numbers(options, LIMITS)
    console = Console(highlight=False, width=100)
    console.print(_steady_table(options))
    if len(options.gaits) > 1:
        console.print(_change_table(options))
    return 0
