"""Groups of training seeds on the command line: `--policies residual=runs/residual/seed-*`."""

import re
from collections.abc import Sequence
from glob import glob, has_magic
from pathlib import Path

import policies
from evaluate.statistics.training_seeds import MIN_SEEDS
from quad_env.cli.command_line import UsageError

SEPARATOR = ","
"""Separator of the policies of a group: `residual=runs/a,runs/b`."""
_GROUP = re.compile(r"([\w.+-]+)=(.+)")
"""Pattern of a group: its name, and the paths or patterns of its policies."""


def expand_patterns(names: Sequence[str]) -> tuple[str, ...]:
    """Replace the patterns in groups of training seeds by the files and folders that they match now.

    The words that the function returns can be stored with a run: they name the same policies later, when further
    trainings are finished. UsageError is raised if a pattern matches nothing, or a group has fewer than two policies.

    Args:
        names: Values of the option --policies; `NAME=PATTERN` is a group.

    Returns:
        The values, with every group as `NAME=PATH,PATH,…`.
    """
    return tuple(_expand(name) for name in names)


def split_groups(names: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[str, ...]]]:
    """Split the values of the option --policies into policies and groups.

    Args:
        names: Values without patterns, as `expand_patterns` returns them.

    Returns:
        names: Names or paths of all policies, including the policies of the groups.
        groups: Name of a group -> names or paths of its policies.

    Raises:
        UsageError: Two groups, or a group and a policy, have the same name.
    """
    members: list[str] = []
    groups: dict[str, tuple[str, ...]] = {}
    for name in names:
        if (parts := _parts(name)) is None:
            members.append(name)
            continue
        group, words = parts
        if group in groups:
            raise UsageError(f"--policies: group {group} given more than once; valid: one name for each group")
        groups[group] = tuple(words.split(SEPARATOR))
        members += groups[group]
    if taken := sorted(set(groups).intersection(members)):
        raise UsageError(f"--policies: {', '.join(taken)} is a group and a policy; valid: another name for the group")
    return tuple(members), groups


def _expand(name: str) -> str:
    """Return a value of --policies, with the patterns of a group replaced by the paths that they match."""
    parts = _parts(name)
    if parts is None:
        return name
    group, words = parts
    paths = [path for word in words.split(SEPARATOR) for path in _matches(group, word)]
    members = [path if path in (*policies.names(), *policies.TRAINED) else path.rstrip("/\\") or path for path in paths]
    if len(members) < MIN_SEEDS:
        raise UsageError(
            f"--policies: group {group} has one training seed, got {words}; valid: {MIN_SEEDS} or more, "
            f"as in {group}=runs/{group}/seed-*"
        )
    return f"{group}={SEPARATOR.join(members)}"


def _matches(group: str, word: str) -> list[str]:
    """Return the paths that match a pattern, numbers in ascending order; a `word` without a pattern is returned as is.

    UsageError, with the name of the `group`, is raised if nothing matches.
    """
    if not has_magic(word) or Path(word).exists():
        return [word]
    paths = [path for path in glob(word) if SEPARATOR not in path]
    if not paths:
        raise UsageError(f"--policies: group {group}: no file or folder matches, got {word}")
    return sorted(paths, key=_natural_key)


def _natural_key(path: str) -> list[tuple[int, str]]:
    """Return a sort key for a path; it sorts `seed-2` before `seed-10`."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", path)]


def _parts(name: str) -> tuple[str, str] | None:
    """Split a value of --policies into name and paths of a group; None if it is no group."""
    match = _GROUP.fullmatch(name)
    if match is None or Path(name).exists():
        return None
    return match[1], match[2]
