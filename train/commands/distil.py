"""`python -m train --teacher POLICY`: distil a policy into a network that runs alone.

The student drives more and more of the time, and the teacher labels every state that the student reaches (DAgger). The
teacher observes the true state, without noise and delay. The result is a policy bundle, as after any training.
"""

import dataclasses
from pathlib import Path
from typing import Any, cast

from evaluate.records.training_run import load_settings
from quad_env.cli import launcher
from quad_env.cli.command_line import UsageError
from quad_env.cli.command_line import parse as parse_options
from quad_env.cli.program import HELP
from train.deployable import without_inputs
from train.distillation.config import DistillationConfig, check, default_settings
from train.run_folder import CONFIG_FILE, has_checkpoint, steps_done
from train.run_record import decode, differences

NAME = "python -m train --teacher"
OUT_OPTION = "--out"
TEACHER_OPTION = "--teacher"
"""Command-line option of `python -m train` that selects the distillation instead of the PPO training."""


def is_requested(words: list[str]) -> bool:
    """Return True if a command line starts or resumes a distillation, the training of a network to imitate a policy.

    Args:
        words: Words of the command line after `python -m train`.

    Returns:
        True if the words contain `--teacher`, or if `--resume` and `--out` name the folder of a distillation.
    """
    if any(word.partition("=")[0] == TEACHER_OPTION for word in words):
        return True
    folder = _out_folder(words)
    if "--resume" not in words or folder is None:
        return False
    return (folder / CONFIG_FILE).is_file() and "teacher" in load_settings(folder)


def _out_folder(words: list[str]) -> Path | None:
    """Return the folder that `--out FOLDER` or `--out=FOLDER` names in a command line; None if neither is there."""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, equals, value = word.partition("=")
        if option == OUT_OPTION and (value or following):
            return Path(value if equals else following)
    return None


def run(words: list[str]) -> int:
    """Distil a policy into a network, with the options of a command line, and return the exit code.

    Args:
        words: Words of the command line after `python -m train`.

    Returns:
        The exit code, 0.

    Raises:
        KeyboardInterrupt: After Ctrl-C. The message has the options that continue the run, if there is a checkpoint.
    """
    config = parse(words)
    # The module is imported here, because the import of torch takes seconds, and --help must answer at once.
    from train.distillation.run import distil

    launcher.raise_on_interrupt()
    try:
        distil(config)
    except KeyboardInterrupt:
        if has_checkpoint(config.folder):
            saved = f"{steps_done(config.folder):,} labels are saved"
            raise KeyboardInterrupt(f"{saved}; continue the run with --resume --out {config.folder}") from None
        raise
    return 0


def parse(words: list[str]) -> DistillationConfig:
    """Parse a command line to the settings of a distillation.

    With --help, the function prints the help and raises SystemExit(0).

    Args:
        words: Words of the command line after `python -m train`.

    Returns:
        The settings. With --resume, an option that is not given has the value of the run that is continued.

    Raises:
        UsageError: An option is unknown, its value is not valid, or it differs from the settings of the run that
            --resume continues.
    """
    words = _without_teacher_of_help(words)
    defaults = _defaults(words)
    config = parse_options(DistillationConfig, words, program=NAME, description=__doc__ or "", default=defaults)
    if config.resume:
        stored = dataclasses.replace(_load(config.folder), out=config.out)
        words = without_set_flags(stored, words)
        config = parse_options(DistillationConfig, words, program=NAME, description="", default=stored)
        if changed := differences(stored, config):
            fact = f"--resume continues a run with its own settings, but {'; '.join(map(str, changed))}"
            raise UsageError(fact)
    check(config)
    return config


def without_set_flags(settings: Any, words: list[str]) -> list[str]:
    """Return the words of a command line without the flags that are on in the settings already.

    A flag that is on by default is no option of the command line any more.

    Args:
        settings: Default settings of the command line, a dataclass.
        words: Words of the command line.

    Returns:
        The other words.
    """
    set_flags = {f"--{name.replace('_', '-')}" for name, value in vars(settings).items() if value is True}
    return [word for word in words if word not in set_flags]


def _defaults(words: list[str]) -> DistillationConfig:
    """Return the values of options that are not given on the command line `words`.

    The values depend on --observations and --sighted.
    """
    selecting = [word for word in without_inputs(words) if word not in HELP]
    try:
        return default_settings(parse_options(DistillationConfig, selecting, program=NAME, description=""))
    except UsageError:
        # The second parse prints the help, or the message about the wrong option.
        return DistillationConfig()


def _without_teacher_of_help(words: list[str]) -> list[str]:
    """Return the words of a command line, but remove `--teacher` if --help follows it instead of a policy.

    Otherwise --help would be read as the name of the policy, and the help would not be printed.
    """
    return [
        word
        for word, following in zip(words, [*words[1:], ""], strict=True)
        if not (word == TEACHER_OPTION and following in HELP)
    ]


def _load(folder: Path) -> DistillationConfig:
    """Load the settings of a distillation from its run folder; raise UsageError if the folder has none."""
    try:
        return cast(DistillationConfig, decode(DistillationConfig, load_settings(folder)))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"{folder} holds no distillation of this version: {error}") from None
