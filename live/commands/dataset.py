"""A Minari dataset: `python -m quad_env dataset simple-quad/trot-rough-v0 --policy trot --scenario rough`."""

from dataclasses import dataclass
from typing import Annotated

import gymnasium as gym
import tyro

import quad_env
from evaluate.commands.options import Flag
from evaluate.rollouts.hardware import hardware_of
from live.commands.episode import one_scenario
from live.dataset import check, create
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.progress import bar

LIMITS = {"episodes": (1, 2000), "seed": (0, 2**63 - 1 - 2000)}


@dataclass(frozen=True)
class Options:
    """Episodes of a policy as a Minari dataset, in MINARI_DATASETS_PATH or ~/.minari/datasets."""

    name: Annotated[str, tyro.conf.Positional]
    """Dataset, as simple-quad/trot-rough-v0; it may not exist."""
    policy: str = "residual"
    """Policy, by name, or folder of a trained one."""
    scenario: str = "flat"
    """Scenario, also with a level or severity: push:3, push=42."""
    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF or TOML."""
    episodes: int = 20
    """Episodes, of 10 s or until the robot falls (count)."""
    seed: int = 0
    """Seed of the first episode; those after it count on (whole number from 0)."""
    author: str = "unknown"
    """Who is named as the dataset's author."""
    trust: Flag = False
    """Load policies from files in which code can be hidden, the .zip files of Stable-Baselines3."""


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    check_numbers(options, LIMITS)
    path = check(options.name)
    hardware = hardware_of(options.robot)
    source = hardware.quadruped.source
    robot = options.robot if source is None else str(source.resolve())
    scenario = one_scenario(options.scenario, hardware)
    policy = hardware.policy(options.policy, options.trust)
    seeds = range(options.seed, options.seed + options.episodes)
    raise_on_interrupt()
    with bar("episodes") as progress:
        env = gym.make(quad_env.ENV_ID, scenario=scenario, robot=robot, height_scan=policy.height_scan)
        try:
            create(options.name, env, policy, seeds, options.author, progress)
        finally:
            env.close()
    print(f"{path}: {options.episodes} episodes of {options.policy} on {scenario.name}")
    return 0
