"""Straight walking at constant speed: `python -m research straight-walking`, as in arXiv 2501.16590.

Several policies walk straight ahead in the same episodes, from a random heading: on level ground, with pushes, and on
uneven ground. The results are success rate and cost of transport, which is computed from all episodes together. All
robots walk at the same Froude numbers (velocity squared, divided by gravity and leg length).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from rich.progress import track

from evaluate.analysis.summary import summarise
from evaluate.cells import LabelledPolicy, evaluation_seeds
from evaluate.hardware import HardwareConfig, parse_robot_option
from evaluate.report.headings import ROW_LABEL
from evaluate.rollouts.run import RunSettings, run_cells
from evaluate.rollouts.workers import process_pool
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.format import number, percent
from quad_env.config import CommandRanges
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_to_robot
from quad_env.scenarios.registry import scenario
from quad_env.scenarios.scenario import Scenario
from research.pages import markdown
from research.pages.blocks import RESULTS, read_page, write_block
from research.pages.csv_text import flatten_entry, to_csv

GROUNDS = {"flat": "level", "push": "pushed", "rough": "uneven"}
"""Name of a scenario -> word that describes the scenario in the tables of results."""
LIMITS = {"episodes": (2, 65_536), "seed": (0, 2**63 - 1), "threads": (1, 256), "speeds": (0.01, 10.0)}
"""Name of an option -> smallest and largest valid value."""


@dataclass(frozen=True)
class StraightWalkingOptions:
    """Options of the command `straight-walking`, which compares policies that walk straight ahead."""

    robot: str = "go1"
    """Robot: a name of quad_env.ROBOTS, or the path of an MJCF, URDF or TOML file."""
    policies: tuple[str, ...] = ("trot", "trot_feedback", "mpc_wbc", "residual")
    """Names or folders of the compared policies."""
    speeds: tuple[float, ...] = (0.3, 0.6, 0.9)
    """Commanded speeds of SimpleQuad, m/s; another robot gets the speed of the same Froude number."""
    episodes: int = 64
    """Number of episodes of 10 s for each policy, speed and ground."""
    seed: int = 0
    """Seed of the episodes, >= 0."""
    table: Path = Path("results/straight_walking.csv")
    """CSV file for the results."""
    page: Path | None = None
    """Markdown file; a short table is written between `<!-- results -->` and `<!-- /results -->`."""
    threads: int = 2
    """Number of processes that simulate; the results do not depend on it."""


def main(options: StraightWalkingOptions) -> int:
    """Run the command `straight-walking`: evaluate the policies, and print and write the results.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid.
    """
    check_numbers(options, LIMITS)
    hardware = parse_robot_option(options.robot)
    if options.page is not None:
        read_page(options.page, RESULTS)
    walks = walk_scenarios(hardware.robot_model, options.speeds)
    for option, names in (("speeds", [walk.name for walk in walks]), ("policies", options.policies)):
        if not names or len(set(names)) < len(names):
            raise UsageError(f"--{option} are to be named, and none twice (speeds to 0.01 m/s)")
    compared = [LabelledPolicy(name, hardware.policy(name)) for name in options.policies]
    make_folder_of(options.table, "--table")
    rows = evaluate_rows(options, hardware, walks, compared)
    write_atomically(options.table, to_csv(rows))
    lines = markdown_lines(options, hardware.robot_model, rows)
    print("\n".join(lines))
    write_block(options.page, lines)
    return 0


def walk_scenarios(robot: Robot, speeds: Sequence[float]) -> list[Scenario]:
    """Create scenarios in which the robot walks straight ahead, one for each ground and speed.

    Args:
        robot: Robot that walks.
        speeds: Commanded speeds of SimpleQuad, m/s. They are scaled to `robot` so that the Froude number, velocity
            squared over gravity and leg length, is the same.

    Returns:
        The scenarios; each has a different name.
    """
    walks = []
    grounds = [scenario(name, robot) for name in GROUNDS]
    for ground, speed in product(grounds, speeds):
        forward = scale_to_robot(robot, speed, "m/s")
        name = f"{ground.name} at {forward:.2f} m/s"
        walks.append(replace(ground, name=name, axis="", commands=CommandRanges.straight(forward)))
    return walks


def evaluate_rows(
    options: StraightWalkingOptions,
    hardware: HardwareConfig,
    walks: Sequence[Scenario],
    compared: Sequence[LabelledPolicy],
) -> list[dict[str, Any]]:
    """Evaluate the policies on all walks.

    Args:
        options: Options of the command.
        hardware: Robot, servo gains, and models of motors and sensors.
        walks: Scenarios in which a robot walks straight ahead.
        compared: Policies to evaluate.

    Returns:
        Row for each walk and policy: name of the column -> value. The columns are ground, speed, policy, the results in
        `evaluate.analysis.summary.Summary`, for example the success rate, and the bounds of their 95 % intervals.
    """
    seeds = evaluation_seeds(options.seed, options.episodes)
    settings = RunSettings(1, lambda *_: None, executor=process_pool(options.threads), hardware=hardware)
    total = len(walks) * len(compared)
    cells = list(track(run_cells(compared, walks, seeds, settings), description="walking", total=total))
    rows = []
    for cell in cells:
        summary = summarise(cell, hardware.robot_model)
        intervals = {f"{name}_ci": interval for name, interval in summary.effort_intervals.items()}
        row = {
            "ground": GROUNDS[cell.scenario.name.split()[0]],
            "speed": cell.scenario.commands.forward[0],
            "policy": cell.policy,
        }
        rows.append(row | flatten_entry(intervals | asdict(summary)))
    return rows


def markdown_lines(options: StraightWalkingOptions, robot: Robot, table: Sequence[Mapping[str, Any]]) -> list[str]:
    """Create the Markdown table of success and cost of transport, and a sentence about the episodes.

    The table has one row per ground and speed, and one column per policy.

    Args:
        options: Options of the command.
        robot: Robot that walks.
        table: Rows from `evaluate_rows`.

    Returns:
        Lines of Markdown.
    """
    push = scenario("push", robot).severity
    rough = scenario("rough", robot).severity
    by_walk: dict[str, dict[str, str]] = {}
    for row in table:
        walk = f"{row['ground']}, {row['speed']:.2f} m/s"
        cells = by_walk.setdefault(walk, {ROW_LABEL: walk})
        cells[row["policy"]] = f"{percent(row['success_rate'])}, {number(row['cost_of_transport'], 2)}"
    heads = {ROW_LABEL: "ground, speed", **{name: f"`{name}`" for name in options.policies}}
    return [
        f"{robot.name}, {robot.mass:.1f} kg; {options.episodes} episodes of 10 s each, the same for all policies; "
        f"pushes of {push:.3g} N·s, ground of {rough:.3g} m. In each cell: success, cost of transport.",
        "",
        markdown.table(heads, by_walk.values()),
    ]
