"""Gait diagrams: `python -m research gait-diagram --gait walk` draws when feet stand, commanded and measured."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluate.measures.averages import Bools
from evaluate.rollouts.observers import Step
from policies.gaits.parameters import GAITS
from policies.gaits.policy import Gaits
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.seeding import episode_seeds
from research.pages.places import make_room_for_picture
from research.studies.strides import Strides, walked

LONGEST = 60.0
"""Longest duration of what is walked or drawn, s."""


@dataclass(frozen=True)
class Options:
    """Draw a gait diagram."""

    gait: str = "walk"
    """Gait to draw: bound, pace, pronk, trot, walk or stand."""
    then: str | None = None
    """Gait to change to at the start of the diagram; none without."""
    out: Path = Path("results/gait.png")
    """PNG to write."""
    command: tuple[float, float, float] = (0.3, 0.0, 0.0)
    """Forward m/s, lateral m/s, yaw rate rad/s."""
    start: float = 3.0
    """Time of the diagram's start, s."""
    length: float = 2.0
    """Time that the diagram shows, s."""
    seed: int = 0
    """Which episode (whole number from 0)."""


def draw(policy: Gaits, strides: Strides, title: str, out: Path) -> None:
    """Write the diagram of the first robot that `policy` walked: a row a foot, the commanded stances pale above the
    measured ones."""
    from matplotlib.figure import Figure

    legs, period = policy.robot.leg_names, policy.control_period
    figure = Figure(figsize=(9, 2.8), layout="constrained")
    axes = figure.subplots()
    for contacts, shift, colour, label in (
        (strides.commanded[:, 0], 0.0, "#9ecae1", "commanded"),
        (strides.measured[:, 0], 0.4, "#08519c", "measured"),
    ):
        for leg, contact in enumerate(contacts.T):
            bars = [(first * period, count * period) for first, count in stances(contact)]
            axes.broken_barh(bars, (leg - 0.4 + shift, 0.4), color=colour, label=label)
            label = "_"
    axes.set(xlabel="time, s", title=title, yticks=range(len(legs)), yticklabels=legs, ylim=(len(legs) - 0.4, -0.6))
    figure.legend(loc="outside right upper", frameon=False)
    figure.savefig(out, dpi=110)


def main(options: Options) -> int:
    """Draw the diagram; the exit code."""
    _check(options)
    policy, title = Gaits(options.gait), " → ".join(filter(None, (options.gait, options.then)))
    first, last = (round(time / policy.control_period) for time in (options.start, options.start + options.length))

    def change(step: Step) -> None:
        if options.then and step.number == first:
            policy.request(options.then)

    seeds = episode_seeds("evaluation", options.seed, 1)
    strides = walked(policy, np.array(options.command), seeds, change, steps=last).since(first)
    draw(policy, strides, title, options.out)
    print(options.out)
    return 0


def _check(options: Options) -> None:
    for gait in (options.gait, options.then or options.gait):
        if gait not in GAITS:
            raise UsageError(f"unknown gait {gait!r}; there are {', '.join(GAITS)}")
    if not (options.start >= 0.0 and options.length >= 0.05 and options.start + options.length <= LONGEST):
        raise UsageError(f"--start must be at least 0 s, --length at least 0.05 s, both together at most {LONGEST:g} s")
    check_numbers(options, {"command": (-10.0, 10.0), "seed": (0, 2**31)})
    make_room_for_picture(options.out, "--out")


def stances(contact: Bools) -> list[tuple[int, int]]:
    """First step and length of every stretch on the ground, of (steps,)."""
    change = np.diff(np.concatenate(([False], contact, [False])).astype(np.int8))
    first, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return list(zip(first.tolist(), (end - first).tolist(), strict=True))
