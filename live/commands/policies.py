"""List the policies: the controllers, the trained policies and their training."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import policies
from evaluate.hardware import parse_robot_option
from policies import bundle, shipped
from policies.description import parse_description
from policies.registry import MAKERS
from policies.summaries import SUMMARIES
from quad_env.cli.format import with_count
from quad_env.files.reading import read_bytes
from quad_env.files.text import one_line
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class PoliciesOptions:
    """Options of the command `policies`, which lists the policies by the names for `--policy`."""

    robot: str = "simple_quad"
    """Robot of the listed trained policies: a name of quad_env.ROBOTS, or the path of an MJCF, URDF or TOML file."""


def main(options: PoliciesOptions) -> int:
    """Run the command `policies` with the given options, and return the exit code of the process."""
    print("\n".join(_lines(parse_robot_option(options.robot).robot_model)))
    return 0


def _lines(robot: Robot) -> Iterator[str]:
    """Yield the lines of the printed list of policies: controllers, then policies that were trained for `robot`."""
    trained = policies.trained_names(robot)
    width = 2 + max(map(len, policies.names(robot)))
    yield "controllers, for any robot"
    of_extensions = [name for name in policies.names(robot) if name not in (*MAKERS, *trained)]
    for name in (*(name for name in SUMMARIES if name not in policies.TRAINED), *of_extensions):
        yield f"  {name:{width}}{policies.summary(name)}"
    yield f"\ntrained for {robot.name}, in {shipped.models_folder(robot)}"
    for name in trained:
        lines = (policies.summary(name, robot), *_training_lines(shipped.models_folder(robot) / name))
        first, *more = filter(None, map(one_line, lines))
        yield f"  {name:{width}}{first}"
        yield from (f"  {'':{width}}{line}" for line in more)
    if not trained:
        yield f"  none: python -m train --robot {robot.source or robot.name} makes one"
    yield "\nsafe: before a name is that policy within the safety layer. Instead of a name there may be the folder of a"
    yield "trained policy, or a file of yours: my_file.py:MyPolicy, my.onnx, my.zip of Stable-Baselines3, deploy.yaml."


def _training_lines(folder: Path) -> Iterator[str]:
    """Yield one line of text about the training of the policy in `folder`, or about an error in its files."""
    try:
        description = parse_description(folder, read_bytes(folder / bundle.DESCRIPTION))
        base = description.base["name"]
        training = description.training
        authority = max(description.authority)
        scenarios = with_count(len(training["mixture"]), "scenario")
        amount = (
            f"{training['labels']:,} labels of {training['teacher']}"
            if "teacher" in training
            else f"{training['steps']:,} steps of training"
        )
        yield f"base {base}, at most {authority:.2g} rad a joint; {amount}, seed {training['seed']}, on {scenarios}"
    except (policies.PolicyError, OSError) as error:
        yield str(error)
    except (KeyError, TypeError, ValueError):  # Another program may have written other fields.
        yield f"of unknown training: {bundle.DESCRIPTION} has none"
