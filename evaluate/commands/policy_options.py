"""Policies that --policies names: `trot`, the folder of a trained one, `document@flat` for one on flat ground alone."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import policies
from evaluate.commands.options import DEFAULT_POLICIES
from evaluate.rollouts.experiment import LabelledPolicy
from evaluate.rollouts.hardware import Hardware
from evaluate.terminal.command_line import UsageError
from quad_env.scenarios.named import Scenario


def policies_asked_for(
    names: tuple[str, ...], scenarios: Sequence[Scenario], hardware: Hardware
) -> tuple[LabelledPolicy, ...]:
    """The policies of these names, each with the scenarios that it is limited to. Raises UsageError."""
    if not names:
        raise UsageError(f"--policies: none given; name at least one of {', '.join(policies.names())}, or a folder")
    if unlimited := [name for name in names if name.endswith("@")]:
        raise UsageError(f"--policies: name scenarios after the @ of {', '.join(unlimited)}, as in document@flat")
    asked = [_parts(name) for name in names]
    if names == DEFAULT_POLICIES:
        run = {scenario.name for scenario in scenarios}
        asked = [(label, only_on) for label, only_on in asked if not only_on or run.intersection(only_on)]
    _check_distinct([label for label, _ in asked])
    _check_scenarios(asked, [scenario.name for scenario in scenarios])
    try:
        return tuple(LabelledPolicy(label, hardware.policy(label), only) for label, only in asked)
    except policies.PolicyError as error:
        raise UsageError(f"--policies: {error}") from error


def words(labels: Iterable[str], only_on: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """What --policies must be given for those policies, of which some are limited to scenarios."""
    return tuple(f"{label}@{','.join(only_on[label])}" if label in only_on else label for label in labels)


def _parts(name: str) -> tuple[str, tuple[str, ...]]:
    """Label, and the scenarios that it is limited to; a folder's name may have an @ of its own."""
    label, _, scenarios = (name, "", "") if Path(name).is_dir() else name.partition("@")
    known = label in policies.names()
    return label if known else label.rstrip("/\\") or label, tuple(filter(None, scenarios.split(",")))


def _check_distinct(labels: list[str]) -> None:
    places = [label if label in policies.names() else str(Path(label).resolve()) for label in labels]
    if repeated := sorted({label for label, place in zip(labels, places, strict=True) if places.count(place) > 1}):
        raise UsageError(f"--policies: {', '.join(repeated)} given more than once; name each policy once")


def _check_scenarios(asked: list[tuple[str, tuple[str, ...]]], scenarios: list[str]) -> None:
    for label, only_on in asked:
        if unknown := [name for name in only_on if name not in scenarios]:
            there = ", ".join(scenarios)
            raise UsageError(f"--policies: {label}@{','.join(unknown)} is not among the scenarios of this run: {there}")
