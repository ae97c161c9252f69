"""`python -m train [run]`: train a policy with PPO, a bounded correction of a base policy or one without a base.

`python -m train --teacher POLICY` distils any policy into a network; see `python -m train --teacher --help`.

Other commands, each with its own --help, as in `python -m train search --help`:
"""

import dataclasses
from collections.abc import Sequence
from typing import Annotated, get_type_hints

from quad_env.cli import launcher
from quad_env.cli.command_line import UsageError, normalise_option_names
from quad_env.cli.command_line import parse as parse_options
from quad_env.cli.program import HELP, Command, Program
from train.commands import distil, seeds
from train.config import DEFAULTS, TrainConfig, check, default_settings
from train.deployable import without_inputs
from train.run_folder import has_checkpoint, steps_done
from train.run_record import differences, load_config

NAME = "python -m train"
COMMANDS = {
    "robot": Command("train.commands.robot", "all steps for your own robot: describe, check, distil, export, compare"),
    "search": Command("train.search.trot", "parameters of a robot's trot, by CMA-ES"),
    "export": Command("train.commands.export", "a trained policy as ONNX, or as deployment files of other projects"),
}
BASIC_OPTIONS = (
    "policy",
    "recipe",
    "base",
    "steps",
    "seed",
    "seeds",
    "part",
    "ray",
    "out",
    "resume",
    "threads",
    "device",
    "observations",
    "sighted",
    "mixture",
    "robot",
    "servo",
)
"""Names of the main options of `python -m train`, which --help explains. --help-all explains all options."""
HELP_ALL = "--help-all"
MOVED_COMMANDS = {
    name: f"now `python -m research {name.split()[0]}`"
    for name in ("ablations", "curves", "publish", "search feedback")
}
MOVED_COMMANDS |= {
    name: f"gone: revision 59ce5e8 has it as `python -m research {name}`" for name in ("sweep", "trials")
}
"""Name of a command of an older version -> message with the new command, shown if a user calls the old one."""


def run(words: list[str]) -> int:
    """Train a policy with the options of a command line, and return the exit code.

    Args:
        words: Words of the command line after `python -m train`. The first word may be `run`.

    Returns:
        The exit code, 0.

    Raises:
        KeyboardInterrupt: After Ctrl-C. The message has the options that continue the training, if the run has a
            checkpoint.
    """
    words = words[1:] if words[:1] == ["run"] else words
    if seeds.is_requested(words):
        return seeds.run(words, lambda each: distil.parse(each) if distil.is_requested(each) else parse(each), run)
    if distil.is_requested(words):
        return distil.run(words)
    config = parse(words)
    # The module is imported here, because the import of torch takes seconds, and --help must answer at once.
    from train.run import train

    launcher.raise_on_interrupt()
    try:
        train(config)
    except KeyboardInterrupt as interrupt:
        if has_checkpoint(config.folder) and steps_done(config.folder) < config.steps:
            remedy = f"continue the run with --resume --out {config.folder}"
            raise KeyboardInterrupt("; ".join([remedy, *map(str, interrupt.args)])) from None
        raise
    return 0


def parse(words: Sequence[str]) -> TrainConfig:
    """Parse a command line of `python -m train` to the settings of a training run.

    With --help, the function prints the help and raises SystemExit(0).

    Args:
        words: Words of the command line after `python -m train`.

    Returns:
        The settings. An option that is not given has the default value for --policy, or with --resume the value of the
        run that is continued.

    Raises:
        UsageError: An option is unknown, its value is not valid, or it differs from the settings of the run that
            --resume continues.
    """
    spelled = normalise_option_names(TrainConfig, list(words))
    words = ["--help" if word == HELP_ALL else word for word in spelled]
    defaults = _defaults(words)
    words = distil.without_set_flags(defaults, words)
    description = f"{__doc__}{PROGRAM.listing()}"
    if HELP & set(spelled):
        basic_config = _basic_config()
        hint = f"{description}\n\nThese are the main options; {HELP_ALL} explains all of them."
        parse_options(basic_config, words, program=NAME, description=hint, default=basic_config(**vars(defaults)))
    config = parse_options(TrainConfig, words, program=NAME, description=description, default=defaults)
    check(defaults)
    check(config)
    if config.resume and (changed := [each for each in differences(defaults, config) if not each.extends]):
        fact = f"--resume continues a run with its own settings, but {'; '.join(map(str, changed))}"
        raise UsageError(f"{fact}; only a larger --steps may be given, to extend it")
    return config


def _defaults(words: list[str]) -> TrainConfig:
    """Return the settings that options have if they are not given on the command line `words`.

    The defaults depend on --policy, and with --resume on the settings of the run that is continued. So the command line
    is parsed twice. This function parses it with the defaults of a residual, to read --policy, --resume and --out. Then
    `parse` parses it again with the defaults that this function returns, and prints the help if requested.
    """
    wants_help = not HELP.isdisjoint(words)
    selecting = [word for word in without_inputs(words) if word not in HELP]
    try:
        given = parse_options(TrainConfig, selecting, program=NAME, description="", default=DEFAULTS["residual"])
    except UsageError:
        if wants_help:
            return DEFAULTS["residual"]
        raise
    if given.resume and not wants_help:
        return dataclasses.replace(load_config(given.folder), out=given.out)
    defaults = default_settings(given)
    if given.start is None:
        return defaults
    # The module is imported here, because the import of torch takes seconds, and --help must answer at once.
    from train.start import with_start_settings

    return with_start_settings(defaults, given.start)


def _basic_config() -> type[TrainConfig]:
    """Return a subclass of TrainConfig with a help text that explains only the options in `BASIC_OPTIONS`."""
    import tyro

    hints = get_type_hints(TrainConfig, include_extras=True)
    hidden = {field.name: field for field in dataclasses.fields(TrainConfig) if field.name not in BASIC_OPTIONS}
    annotations = {name: Annotated[hints[name], tyro.conf.Suppress] for name in hidden}
    return dataclasses.dataclass(frozen=True)(type("Brief", (TrainConfig,), {**hidden, "__annotations__": annotations}))


PROGRAM = Program(NAME, COMMANDS, run, MOVED_COMMANDS)
