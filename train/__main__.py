"""`python -m train`: train a policy; the options are the fields of `train.config.TrainConfig`.

Other commands, each with its own --help: `search trot`, `search gait`, `search feedback`, `search recovery`,
`search fall-prediction`, `publish`.
"""

from evaluate.terminal import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()

import argparse
import contextlib
import dataclasses
import io
import sys
from importlib import import_module
from pathlib import Path

from evaluate.terminal.command_line import UsageError, fail, first_sentence
from train.config import DEFAULTS, TrainConfig, differences, load_config
from train.run_folder import has_checkpoint
from train.setting_ranges import check

PROGRAM = "python -m train"
COMMANDS = {
    ("search", "trot"): "train.search.trot",
    ("search", "gait"): "train.search.gait",
    ("search", "feedback"): "train.search.feedback",
    ("search", "recovery"): "train.search.recovery",
    ("search", "fall-prediction"): "train.search.fall_prediction",
    ("publish",): "train.publish",
}
"""First words of the command line -> module whose `main` it runs with the rest."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command; gives the exit code: 0, 2 on bad input, 130 after Ctrl-C."""
    words = sys.argv[1:] if arguments is None else arguments
    for command, module in COMMANDS.items():
        if tuple(words[: len(command)]) == command:
            code: int = import_module(module).main(words[len(command) :])
            return code
    from policies.base import PolicyError

    config = None
    try:
        config = parse(words)
        # Only now, so that --help and mistakes answer at once: torch takes seconds to import.
        from train.run import train

        launcher.raise_on_interrupt()
        train(config)
    except BrokenPipeError:  # the reader of --help has seen enough; the launcher ends quietly
        raise
    except (UsageError, PolicyError, OSError) as error:
        return fail(str(error))
    except KeyboardInterrupt:
        kept = config is not None and has_checkpoint(config.folder)
        print(f"stopped; {'carry the run on with --resume' if kept else 'nothing was kept'}", file=sys.stderr)
        return launcher.INTERRUPTED
    return 0


def parse(arguments: list[str]) -> TrainConfig:
    """The settings of a command line. Raises UsageError; SystemExit(0) after --help.

    The defaults shown and used are those of the chosen --policy, or with --resume those of the run that is carried on.
    """
    import tyro

    defaults = _defaults(arguments)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            config = tyro.cli(TrainConfig, prog=PROGRAM, args=arguments, default=defaults)
    except SystemExit as end:
        if not end.code:
            raise
        raise UsageError(f"{first_sentence(complaint.getvalue())}; see `{PROGRAM} --help`") from None
    check(config)
    if config.resume and (changed := differences(defaults, config)):
        raise UsageError(f"--resume carries a run on as it was begun, but {'; '.join(map(str, changed))}")
    return config


def _defaults(arguments: list[str]) -> TrainConfig:
    scout = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    scout.add_argument("--policy", choices=list(DEFAULTS), default="residual")
    scout.add_argument("--seed", type=int, default=0)
    scout.add_argument("--out", type=Path)
    scout.add_argument("--resume", action="store_true")
    try:
        found, _ = scout.parse_known_args(arguments)
    except (argparse.ArgumentError, SystemExit):
        return DEFAULTS["residual"]  # tyro, which reads the same words next, says what is wrong with them
    defaults = DEFAULTS[found.policy]
    if found.resume and "--help" not in arguments and "-h" not in arguments:
        folder = dataclasses.replace(defaults, seed=found.seed, out=found.out).folder
        return dataclasses.replace(load_config(folder), out=found.out)
    return defaults


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
