"""`python -m train [run]`: train a policy with PPO, a bounded correction of a base policy or one without a base.

Other commands, each with its own --help, as in `python -m train search --help`:
"""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, get_type_hints

from quad_env.cli import launcher
from quad_env.cli.command_line import UsageError, normalise_option_names
from quad_env.cli.command_line import parse as parse_options
from quad_env.cli.program import HELP, Command, Program
from train.config import DEFAULTS, TrainConfig, check
from train.run_folder import has_checkpoint, steps_done
from train.run_record import differences, load_config

NAME = "python -m train"
COMMANDS = {
    "robot": Command("train.commands.robot", "all steps for your own robot: describe, search, train, evaluate, report"),
    "search": Command("train.search.trot", "parameters of a robot's trot, by CMA-ES"),
    "export": Command("train.commands.export", "a trained residual as an ONNX file"),
}
BASIC_OPTIONS = (
    "policy",
    "base",
    "steps",
    "seed",
    "out",
    "resume",
    "threads",
    "device",
    "sighted",
    "mixture",
    "robot",
    "servo",
)
"""Settings that --help explains."""
ALL = "--help-all"
MOVED = {
    name: f"now `python -m research {name.split()[0]}`"
    for name in ("ablations", "curves", "publish", "search feedback")
}
MOVED |= {name: f"gone: revision 59ce5e8 has it as `python -m research {name}`" for name in ("sweep", "trials")}
"""Where commands of older versions are."""


def run(words: list[str]) -> int:
    """Train as the words say, which may begin with `run`; the exit code."""
    config = parse(words[1:] if words[:1] == ["run"] else words)
    # Only now, so that --help and mistakes answer at once: torch takes seconds to import.
    from train.run import train

    launcher.raise_on_interrupt()
    try:
        train(config)
    except KeyboardInterrupt as interrupt:
        if has_checkpoint(config.folder) and steps_done(config.folder) < config.steps:
            said = [f"continue the run with --resume --out {config.folder}", *map(str, interrupt.args)]
            raise KeyboardInterrupt("; ".join(said)) from None
        raise
    return 0


def parse(words: Sequence[str]) -> TrainConfig:
    """The settings of a command line. Raises UsageError; SystemExit(0) after --help.

    The defaults are those of the chosen --policy and --base, or with --resume those of the run that is continued.
    """
    asked = normalise_option_names(TrainConfig, list(words))
    words = ["--help" if word == ALL else word for word in asked]
    defaults, description = _defaults(words), f"{__doc__}{PROGRAM.listing()}"
    if HELP & set(asked):
        brief, said = _basic_config(), f"{description}\n\nThese are the main options; {ALL} explains all of them."
        parse_options(brief, words, program=NAME, description=said, default=brief(**vars(defaults)))
    config = parse_options(TrainConfig, words, program=NAME, description=description, default=defaults)
    check(defaults)
    check(config)
    if config.resume and (changed := [each for each in differences(defaults, config) if not each.extends]):
        said = f"--resume continues a run with its own settings, but {'; '.join(map(str, changed))}"
        raise UsageError(f"{said}; only a larger --steps may be given, to extend it")
    return config


def _basic_config() -> type[TrainConfig]:
    """The settings, of which the help text shows those of MAIN alone."""
    import tyro

    hints = get_type_hints(TrainConfig, include_extras=True)
    hidden = {each.name: each for each in dataclasses.fields(TrainConfig) if each.name not in BASIC_OPTIONS}
    annotations = {name: Annotated[hints[name], tyro.conf.Suppress] for name in hidden}
    return dataclasses.dataclass(frozen=True)(type("Brief", (TrainConfig,), {**hidden, "__annotations__": annotations}))


def _defaults(words: list[str]) -> TrainConfig:
    scout = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    scout.add_argument("--policy", choices=list(DEFAULTS), default="residual")
    scout.add_argument("--robot", default=TrainConfig.robot)
    scout.add_argument("--seed", type=int, default=0)
    scout.add_argument("--out", type=Path)
    scout.add_argument("--resume", action="store_true")
    try:
        found, _ = scout.parse_known_args(words)
    except (argparse.ArgumentError, SystemExit):
        return DEFAULTS["residual"]  # the real parser, which reads the same words next, says what is wrong with them
    defaults = dataclasses.replace(DEFAULTS[found.policy], robot=found.robot)
    if found.resume and not HELP & set(words):
        asked = dataclasses.replace(defaults, seed=found.seed, out=found.out)
        return dataclasses.replace(load_config(asked.folder), out=found.out)
    return defaults


PROGRAM = Program(NAME, COMMANDS, run, MOVED)
