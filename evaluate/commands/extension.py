"""Extension of a finished run: `--add POLICY --out RUN`, and more episodes: `--episodes 48 --out RUN`."""

import shlex
from collections.abc import Sequence
from dataclasses import replace

from evaluate.commands.options import PROGRAM, RESULT_NEUTRAL_OPTIONS, EvaluateOptions, describe_changes
from evaluate.commands.plan import Plan, check
from evaluate.records import manifest as manifests
from evaluate.records.manifest import Manifest
from evaluate.records.store import is_unfinished, read_run
from quad_env.cli.command_line import UsageError

EXTENDING_OPTIONS = {"episodes", "add"}
"""Names of the options that extend a finished run."""


def is_extension(options: EvaluateOptions, words: Sequence[str]) -> bool:
    """Return True if a command line extends the finished run in the folder --out.

    The option --add always does. The option --episodes does if the command line names the folder of a finished run with
    fewer episodes, and no option that changes results.

    Args:
        options: Options of the command line.
        words: Words of the command line.

    Returns:
        True if the run is extended, False if a new run starts.

    Raises:
        UsageError: The command line has both --add and --resume.
    """
    if options.add and options.resume:
        raise UsageError("--add: extends a finished run, got --resume as well; valid: one of them")
    if options.add or options.resume:
        return bool(options.add)
    given = {word.partition("=")[0].removeprefix("--").replace("-", "_") for word in words if word.startswith("--")}
    if not {"episodes", "out"} <= given <= {"episodes", *RESULT_NEUTRAL_OPTIONS}:
        return False
    if not (options.out / manifests.NAME).is_file() or is_unfinished(options.out):
        return False
    return manifests.read(options.out).episodes < options.max_episodes


def check_extension(options: EvaluateOptions, stored: EvaluateOptions) -> Plan:
    """Check the options of an extension, and plan the extended run.

    Args:
        options: Options of the command line, with the options of the finished run as defaults.
        stored: Options of the finished run.

    Returns:
        The plan of the extended run.

    Raises:
        UsageError: The run is not finished, an option other than --add and --episodes differs, or an input has changed.
    """
    out = options.out
    name = "--add" if options.add else "--episodes"
    if stored.part is not None:
        raise UsageError(
            f"{name}: {out} is part {stored.part} of a run; valid: a finished run, after `{PROGRAM} merge`"
        )
    then = manifests.read(out)
    _check_number_of_episodes(options, stored, then)
    same = replace(options, episodes=stored.episodes)
    if changes := describe_changes(stored, same):
        raise UsageError(f"{name}: keeps the options of the run, but {'; '.join(changes)}; valid: leave them out")
    if not read_run(out).complete:
        finish = f"{PROGRAM} --resume --out {shlex.quote(str(out))}"
        raise UsageError(f"{name}: {out} is not finished; valid: a finished run, after `{finish}`")
    plan = check(replace(options, policies=(*stored.policies, *options.add), add=()))
    if changes := manifests.differences(then, plan.manifest):
        raise UsageError(f"{name}: {out} cannot be extended, for {'; '.join(changes)}; valid: a new run, another --out")
    # A run that its time limit has ended keeps its number of episodes.
    manifest = plan.manifest
    if then.out_of_time:
        manifest = replace(manifest, episodes=then.episodes, ended=then.ended, out_of_time=True)
    return replace(plan, manifest=manifest, extends=True)


def _check_number_of_episodes(options: EvaluateOptions, stored: EvaluateOptions, then: Manifest) -> None:
    """Check that a finished run can have the number of episodes, or the policies, that an extension adds.

    Args:
        options: Options of the command line.
        stored: Options of the finished run.
        then: Manifest of the finished run.

    Raises:
        UsageError: The run has more episodes, or the run has a variable number of episodes.
    """
    name = "--add" if options.add else "--episodes"
    if then.ended and not then.out_of_time:
        fact = f"{name}: {options.out} is a run that ended as its ranking was settled"
        raise UsageError(f"{fact}; valid: a run with a fixed number of episodes")
    if then.limit and options.max_episodes != stored.max_episodes:
        fact = f"--episodes: {options.out} is a run with a time limit, which has {then.episodes}"
        raise UsageError(f"{fact}, got {options.max_episodes}; valid: a new run, another --out")
    if options.max_episodes < stored.max_episodes:
        raise UsageError(f"--episodes: the run has {stored.max_episodes}, got {options.max_episodes}; valid: more")
