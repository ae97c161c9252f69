"""`python -m train --seeds 0-4`: train several seeds one after the other, or with `--ray` on a cluster.

The option `--part K/N` trains a share of the seeds.
"""

import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.cli.part import parse_part, select_items
from quad_env.cli.program import HELP
from quad_env.cli.ray_option import parse_ray
from train.config import MAX_SEED, TrainConfig
from train.distillation.config import DistillationConfig
from train.run_folder import has_checkpoint, refuse_folder_in_use, steps_done

Settings = TrainConfig | DistillationConfig
SEEDS_OPTION = "--seeds"
PART_OPTION = "--part"
RAY_OPTION = "--ray"
RESUME_OPTION = "--resume"
MAX_SEEDS = 10_000
"""Largest number of seeds of one command."""
_REMEDY = f"the same command with {RESUME_OPTION} continues all seeds"
_RANGE = re.compile(r"(\d{1,10})-(\d{1,10})")
_LIST = re.compile(r"\d{1,10}(,\d{1,10})*")


def is_requested(words: Sequence[str]) -> bool:
    """Return True if a command line trains several seeds, a part of them or on a cluster, and does not ask for help.

    Args:
        words: Words of the command line after `python -m train`.

    Returns:
        True if the words contain `--seeds`, `--part` or `--ray`.
    """
    names = {word.partition("=")[0] for word in words}
    return bool(names & {SEEDS_OPTION, PART_OPTION, RAY_OPTION}) and names.isdisjoint({*HELP, "--help-all"})


def run(words: list[str], parse: Callable[[list[str]], Settings], train_seed: Callable[[list[str]], int]) -> int:
    """Train the seeds that a command line names, each in its own run folder, and return the exit code.

    Args:
        words: Words of the command line after `python -m train`.
        parse: Function that parses words to the checked settings of a run.
        train_seed: Function that trains one seed with the options of its words, and returns the exit code.

    Returns:
        The exit code, 0.

    Raises:
        KeyboardInterrupt: After Ctrl-C. The message has the option that continues all seeds.
    """
    resume = RESUME_OPTION in words
    settings = parse([word for word in words if word != RESUME_OPTION])
    chosen = _select_seeds(settings, words)
    folders = {seed: _run_folder(settings, seed) for seed in chosen}
    if not resume:
        for folder in folders.values():
            refuse_folder_in_use(folder)
    shared_words = _without_options(_without_ray(words), {SEEDS_OPTION, PART_OPTION, "--out"})
    if settings.ray is not None:
        unfinished = [item for item in folders.items() if not (resume and _is_finished(settings, item[1]))]
        return _train_on_cluster(settings.ray, [parse(_words_of_run(shared_words, *item)) for item in unfinished])
    for index, (seed, folder) in enumerate(folders.items(), 1):
        heading = f"seed {seed}, {index} of {len(folders)}, in {folder}"
        if resume and _is_finished(settings, folder):
            print(f"{heading}: finished", flush=True)
            continue
        print(heading, flush=True)
        try:
            train_seed(_words_of_run(shared_words, seed, folder))
        except KeyboardInterrupt as interrupt:
            raise KeyboardInterrupt("; ".join([*map(str, interrupt.args), _REMEDY])) from None
    return 0


def _words_of_run(shared_words: Sequence[str], seed: int, folder: Path) -> list[str]:
    """Return the words of the command line that trains one seed; a run with a checkpoint is resumed if requested."""
    words = [word for word in shared_words if word != RESUME_OPTION or has_checkpoint(folder)]
    return [*words, "--seed", str(seed), "--out", str(folder)]


def _train_on_cluster(option: tuple[str, ...], runs: Sequence[Settings]) -> int:
    """Train runs as tasks of a Ray cluster, and return the exit code.

    Args:
        option: Value of the option --ray.
        runs: Settings of each run.

    Returns:
        The exit code, 0.

    Raises:
        KeyboardInterrupt: After Ctrl-C. The message has the option that continues all seeds.
    """
    address = parse_ray(option)
    # The module is imported here, because the import of torch takes seconds, and an error must be shown at once.
    from train.cluster import train_on_cluster

    raise_on_interrupt()
    try:
        train_on_cluster(runs, address)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the checkpoints so far are kept; {_REMEDY}") from None
    return 0


def parse_seeds(text: str) -> list[int]:
    """Parse the value of the option --seeds.

    Args:
        text: Range such as `0-4`, with both ends included, or list such as `0,3,7`.

    Returns:
        The seeds.

    Raises:
        UsageError: The text is not of this form, a seed is repeated or too large, or there are too many seeds.
    """
    found: Sequence[int] = []
    if match := _RANGE.fullmatch(text):
        found = range(int(match[1]), int(match[2]) + 1)
    elif _LIST.fullmatch(text):
        found = [int(word) for word in text.split(",")]
    if not 0 < len(found) <= MAX_SEEDS or max(found) > MAX_SEED or len(set(found)) < len(found):
        valid = f"a range such as 0-4 or a list such as 0,3,7, at most {MAX_SEEDS} different seeds up to {MAX_SEED}"
        raise UsageError(f"{SEEDS_OPTION}: no seeds, got {text}; valid: {valid}")
    return list(found)


def _select_seeds(settings: Settings, words: Sequence[str]) -> Sequence[int]:
    """Return the seeds to train: those that `settings` names, or with --part a share of them.

    Args:
        settings: Settings that the command line gives.
        words: Words of the command line.

    Returns:
        The seeds.

    Raises:
        UsageError: An option is missing or not valid.
    """
    if settings.seeds is None and settings.part is None:
        raise UsageError(f"{RAY_OPTION}: needs {SEEDS_OPTION}, got none; valid: --seeds 0-4 --ray")
    if settings.seeds is None:
        raise UsageError(f"{PART_OPTION}: needs {SEEDS_OPTION}, got none; valid: --seeds 0-4 --part 2/5")
    if any(word.partition("=")[0] == "--seed" for word in words):
        raise UsageError(f"--seed and {SEEDS_OPTION}: both name seeds; valid: one of them")
    all_seeds = parse_seeds(settings.seeds)
    if settings.part is None:
        return all_seeds
    chosen = select_items(all_seeds, parse_part(settings.part))
    if not chosen:
        print(f"part {settings.part} has no seed: there are only {len(all_seeds)}")
    return chosen


def _run_folder(settings: Settings, seed: int) -> Path:
    """Return the run folder of a `seed`: the default name of the folder, in the folder --out if it is given."""
    folder = dataclasses.replace(settings, seed=seed, out=None).folder
    return folder if settings.out is None else settings.out / folder.name


def _is_finished(settings: Settings, folder: Path) -> bool:
    """Return True if the run in a `folder` has all steps, or all updates, of the `settings`."""
    if isinstance(settings, TrainConfig):
        return steps_done(folder) >= settings.steps
    # The module is imported here, because the import of torch takes seconds, and an error must be shown at once.
    from train.distillation.run import is_finished

    return is_finished(folder)


def _without_ray(words: Sequence[str]) -> list[str]:
    """Return the words of a command line without the option --ray, which has at most one value."""
    kept: list[str] = []
    is_value = False
    for word in words:
        option, equals, _ = word.partition("=")
        if option == RAY_OPTION:
            is_value = not equals
            continue
        if not is_value or word.startswith("--"):
            kept.append(word)
        is_value = False
    return kept


def _without_options(words: Sequence[str], names: set[str]) -> list[str]:
    """Return the words of a command line without some options and their values.

    Args:
        words: Words of the command line.
        names: Names of the options; each takes one value.

    Returns:
        The other words.
    """
    kept = []
    is_value = False
    for word in words:
        option, equals, _ = word.partition("=")
        if not is_value and option not in names:
            kept.append(word)
        is_value = not is_value and option in names and not equals
    return kept
