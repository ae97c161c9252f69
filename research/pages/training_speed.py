"""Speed of training in docs/training.md: `python -m research training-speed SPEED_JSON`.

`python -m benchmarks.training --json SPEED_JSON` writes the file SPEED_JSON. This command writes its table of the
physics options and its table of a learner sample.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.files.reading import read_bytes
from research.pages.blocks import read_page, write_block
from research.pages.markdown import table

PHYSICS = "training-physics"
"""Name of the block with the table of the physics options."""
SAMPLE = "training-sample"
"""Name of the block with the table of a learner sample."""
PARTS = {
    "physics": "physics: MuJoCo",
    "environment": "environment: observations, rewards, resets",
    "features": "inputs of the networks, data for the learner",
    "network": "actions and values in the rollout",
    "update": "update",
    "total": "learner sample",
    "bare physics": "bare `Batch.step` of the same states and targets",
    "bare update": "bare PyTorch update of the same networks and minibatches",
    "physics / bare": "physics / bare `Batch.step`",
    "update / bare": "update / bare update",
    "total / bare": "learner sample / both bare loops",
}
"""Name of a value in the file -> row of the table of a learner sample; names with a slash are ratios."""


@dataclass(frozen=True)
class TrainingSpeedOptions:
    """Options of the command `training-speed`."""

    results: Annotated[Path, tyro.conf.Positional]
    """JSON file of `python -m benchmarks.training`; the table of a measurement that it lacks stays as it is."""
    page: Path = Path("docs/training.md")
    """Markdown page with the blocks `training-physics` and `training-sample`."""


def main(options: TrainingSpeedOptions) -> int:
    """Run the command `training-speed`: write both tables into the page.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: The file cannot be read, or lacks a measurement.
    """
    read_page(options.page, PHYSICS, SAMPLE)
    try:
        record = json.loads(read_bytes(options.results))
        figures = record["figures"]
        blocks = {
            name: make_lines(figures[key])
            for name, key, make_lines in ((PHYSICS, "physics", physics_lines), (SAMPLE, "sample", sample_lines))
            if key in figures
        }
        machine = record["machine"]
        footer = f"{machine['cpu']}, load {machine['load']}, MuJoCo {machine['mujoco']}, medians [quartiles]."
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        fact = f"no measurement sample or physics of `python -m benchmarks.training` ({type(error).__name__})"
        raise UsageError(f"{options.results}: {fact}; valid: a file of its option --json") from None
    for name, lines in blocks.items():
        write_block(options.page, [*lines, "", footer], name)
    return 0


def physics_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return the lines of the Markdown table of the physics options.

    Args:
        figures: Name of a robot -> name of a setting -> `us`, `steps/s` and `speed`.

    Returns:
        Lines of the table, with one row per setting, and two columns per robot.
    """
    heads = {"setting": "physics of a learner sample of 20 ms"}
    for robot in figures:
        heads[f"{robot} us"] = f"{robot}, µs"
        heads[f"{robot} steps"] = f"{robot}, samples/s"
        heads[f"{robot} speed"] = f"{robot}, speed / the default's"
    rows = []
    for name in next(iter(figures.values()), {}):
        row = {"setting": f"`{name}`" if name.startswith("--") else name}
        for robot, settings in figures.items():
            row[f"{robot} us"] = number(settings[name]["us"]["median"], 1)
            row[f"{robot} steps"] = f"{settings[name]['steps/s']:,.0f}"
            row[f"{robot} speed"] = _with_quartiles(settings[name]["speed"], 2)
        rows.append(row)
    return table(heads, rows).splitlines()


def sample_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return the lines of the Markdown table of a learner sample.

    Args:
        figures: Name of a robot -> name of a value -> quartiles; the values are times, µs, and ratios.

    Returns:
        Lines of the table, with one row per value, and one column per robot.
    """
    heads = {"part": "one thread, µs of processor time"} | {robot: robot for robot in figures}
    rows = []
    for name, text in PARTS.items():
        digits = 2 if "/" in name else 1
        rows.append(
            {"part": text} | {robot: _with_quartiles(values[name], digits) for robot, values in figures.items()}
        )
    return table(heads, rows).splitlines()


def _with_quartiles(value: Mapping[str, float], digits: int) -> str:
    """Format median and quartiles as `1.24 [1.20 … 1.31]`."""
    texts = [number(value[name], digits) for name in ("median", "low", "high")]
    return f"{texts[0]} [{texts[1]} … {texts[2]}]"
