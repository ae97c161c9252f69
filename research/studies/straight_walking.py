"""Straight walking at constant speed: `python -m research straight-walking --robot go1` compares policies as the
benchmark of predictive and learned controllers on a Go1 does (arXiv 2501.16590): speed held, pushes, uneven ground, and
what a metre costs.

Every policy walks the same episodes, straight ahead from any heading, at speeds of the same Froude number for every
robot. The cost of transport is mechanical energy over weight and way, of the episodes that are walked to their end.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.progress import track

from evaluate.measures.metrics import Measures
from evaluate.measures.tracking import VELOCITY_CAP
from evaluate.rollouts.experiment import LabelledPolicy, Settings, evaluation_seeds, run_cells
from evaluate.rollouts.hardware import Hardware, hardware_of
from evaluate.rollouts.workers import process_pool
from evaluate.statistics.intervals import UNBOUNDED, bootstrap_interval, wilson_interval
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.format import ABSENT, number, share
from quad_env.config import CommandRanges
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scaled
from quad_env.scenarios.named import scenario
from quad_env.scenarios.scenario import Scenario
from research.pages.places import RESULTS, insert, page_with

GROUNDS = {"flat": "level", "push": "pushed", "rough": "uneven"}
"""Scenarios, and what to call them."""
LIMITS = {"episodes": (2, 65_536), "seed": (0, 2**63 - 1), "threads": (1, 256), "speeds": (0.01, 10.0)}


@dataclass(frozen=True)
class Options:
    """Compare policies in walking straight ahead."""

    robot: str = "go1"
    """Robot of every policy: a name of quad_env.ROBOTS, or the path of its MJCF or TOML."""
    policies: tuple[str, ...] = ("trot", "trot_feedback", "mpc_wbc", "residual")
    """Names or folders of policies."""
    speeds: tuple[float, ...] = (0.3, 0.6, 0.9)
    """Commanded speeds, m/s of SimpleQuad; the robot's are as fast for its size."""
    episodes: int = 64
    """Episodes of 10 s of each policy, speed and ground (count)."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    page: Path | None = None
    """Markdown file with the lines `<!-- results -->` and `<!-- /results -->`, between which the table goes."""
    threads: int = 2
    """Processes that simulate side by side (count). No outcome depends on it."""


def main(options: Options) -> int:
    """Walk, print and write; the exit code. Raises UsageError."""
    check_numbers(options, LIMITS)
    hardware = hardware_of(options.robot)
    page = None if options.page is None else page_with(options.page, RESULTS)
    walks = scenarios(hardware.quadruped, options.speeds)
    for option, given in (("speeds", [walk.name for walk in walks]), ("policies", options.policies)):
        if not given or len(set(given)) < len(given):
            raise UsageError(f"--{option} are to be named, and none twice (speeds to 0.01 m/s)")
    compared = [LabelledPolicy(name, hardware.policy(name)) for name in options.policies]
    lines = list(table(options, hardware, walks, compared))
    print("\n".join(lines))
    if page is not None and options.page is not None:
        write_atomically(options.page, insert(page, lines).encode())
    return 0


def scenarios(robot: Robot, speeds: Sequence[float]) -> list[Scenario]:
    """Walks straight ahead on every ground at every speed, m/s of SimpleQuad, each with a name of its own."""
    found = []
    for name in GROUNDS:
        ground = scenario(name, robot)
        for speed in speeds:
            ahead = scaled(robot, speed, "m/s")
            straight = CommandRanges.straight(ahead)
            found.append(replace(ground, name=f"{name} at {ahead:.2f} m/s", axis="", commands=straight))
    return found


def table(
    options: Options, hardware: Hardware, walks: Sequence[Scenario], compared: Sequence[LabelledPolicy]
) -> Iterator[str]:
    """Lines of the table, in Markdown."""
    robot = hardware.quadruped
    push, rough = scenario("push", robot).severity, scenario("rough", robot).severity
    yield (
        f"{robot.name}, {robot.mass:.1f} kg; {options.episodes} episodes of 10 s each, the same for all; pushes of "
        f"{push:.3g} N·s, ground of {rough:.3g} m from valley to peak. In brackets 95 % intervals."
    )
    yield ""
    yield "| ground, speed | policy | success | falls | velocity error, m/s | cost of transport |"
    yield "|---|---|---|---|---|---|"
    seeds = evaluation_seeds(options.seed, options.episodes)
    settings = Settings(1, lambda *_: None, executor=process_pool(options.threads), hardware=hardware)
    total = len(walks) * len(compared)
    cells = list(track(run_cells(compared, walks, seeds, settings), description="walking", total=total))
    for walk in walks:
        words = f"{GROUNDS[walk.name.split()[0]]}, {walk.commands.forward[0]:.2f} m/s"
        for policy in compared:
            (cell,) = (each for each in cells if each.scenario.name == walk.name and each.policy == policy.label)
            yield f"| {words} | `{policy.label}` | {' | '.join(_figures(cell.measures))} |"


def _figures(measures: Measures) -> Iterator[str]:
    """Success, falls, velocity error and cost of transport of the episodes that were walked to their end."""
    for counted in (measures.succeeded, measures.fell):
        yield share(counted.mean(), wilson_interval(int(counted.sum()), len(counted)))
    whole = measures.cost_of_transport[~measures.fell & np.isfinite(measures.cost_of_transport)]
    for values, digits, bounds in ((measures.velocity_error, 3, (0.0, VELOCITY_CAP)), (whole, 2, UNBOUNDED)):
        if len(values) < 2:
            yield ABSENT
        else:
            low, high = (number(end, digits) for end in bootstrap_interval(values, bounds))
            yield f"{number(values.mean(), digits)} [{low}, {high}]"
