"""`python -m evaluate compare A B`: two results folders, such as those of two commits or of two machines."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.analysis.comparison import (
    ERRORS,
    FALL_RATE,
    METRICS,
    RATES,
    SUCCESS_RATE,
    MetricDifference,
    compare_samples,
)
from evaluate.analysis.results import without_nan
from evaluate.measures.outcomes import SUCCEEDED, SUCCESS_1, SUCCESS_RULE
from evaluate.records.episode_table import by_energy_rule, by_success_rule
from evaluate.records.manifest import Manifest, differences
from evaluate.records.store import read_rows, rows_of
from evaluate.report.headings import FIRST, NARROW_DIFFERENCES
from evaluate.report.table import console_table, row_name
from evaluate.statistics.intervals import Floats
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import ABSENT, counted, interval, number, p_value, points, points_interval
from quad_env.files.writing import write_atomically


@dataclass(frozen=True)
class Options:
    """What to compare."""

    a: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation, finished or not."""
    b: Annotated[Path, tyro.conf.Positional]
    """Another; differences are B minus A."""
    policies: tuple[str, str] | None = None
    """A policy of A and the policy of B to compare it with; by default every policy that both have."""
    json: Path | None = None
    """File for the figures."""


@dataclass(frozen=True)
class Match:
    """One policy on one scenario in both folders."""

    a: str
    b: str
    """Policies"""
    scenario: str
    paired: bool
    why_not: str
    """What keeps the episodes from being paired; empty if they are."""
    episodes: tuple[int, int]
    """Of A and of B; where they are paired and not as many, those of the same seeds are compared alone."""
    common: int
    """Episodes of the same seeds."""
    identical: bool
    """Every column of every episode that is compared is the same to the bit."""
    contrasts: tuple[MetricDifference, ...]


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    if options.json is not None:
        make_folder_of(options.json, "--json")
    a, b = map(_read, (options.a, options.b))
    rules = a[0].success_rule, b[0].success_rule
    if rules[0] != rules[1]:
        a, b = ((manifest, by_success_rule(rows, manifest.success_rule)) for manifest, rows in (a, b))
    if a[0].energy_rule != b[0].energy_rule:
        a, b = ((manifest, by_energy_rule(rows, manifest.energy_rule)) for manifest, rows in (a, b))
    pairs = _pairs(options, a[0], b[0])
    scenarios = dict.fromkeys(a[1].column("scenario").to_pylist())
    found = [_match(scenario, pair, a, b) for scenario in scenarios for pair in pairs]
    matches = [match for match in found if match]
    if not matches:
        raise UsageError(f"{options.a} and {options.b} have no scenario of these policies in common")
    console, changed = Console(), differences(a[0], b[0])
    console.print(_table(options, matches))
    for line in (
        *_notes(matches, rules),
        *_left_out(a, b),
        f"A and B differ in: {'; '.join(changed) or 'nothing that is known'}",
    ):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        _write(options, matches, changed, options.json)
        console.print(str(options.json), highlight=False, markup=False, soft_wrap=True)
    return 0


def _read(path: Path) -> tuple[Manifest, pa.Table]:
    folder = path.parent if path.name in ("results.json", "episodes.parquet", "manifest.json") else path
    manifest, rows = read_rows(folder)
    if not rows.num_rows:
        raise UsageError(f"{folder} holds no finished part of a comparison yet")
    return manifest, rows


def _pairs(options: Options, a: Manifest, b: Manifest) -> list[tuple[str, str]]:
    """Which policy of A goes with which of B. Raises UsageError."""
    if options.policies is not None:
        for policy, manifest, folder in zip(options.policies, (a, b), (options.a, options.b), strict=True):
            if policy not in manifest.policies:
                raise UsageError(f"--policies: {folder} has no {policy}, but {', '.join(manifest.policies)}")
        return [options.policies]
    common = [(policy, policy) for policy in a.policies if policy in b.policies]
    if not common and len(a.policies) == len(b.policies) == 1:
        return [(next(iter(a.policies)), next(iter(b.policies)))]
    if not common:
        names = f"A has {', '.join(a.policies)} and B has {', '.join(b.policies)}"
        raise UsageError(f"no policy is in both: {names}; say --policies ONE_OF_A ONE_OF_B")
    return common


def _match(
    scenario: str, pair: tuple[str, str], a: tuple[Manifest, pa.Table], b: tuple[Manifest, pa.Table]
) -> Match | None:
    """The pair of policies on that scenario; None where one of them did not run on it."""
    rows = [rows_of(table, policy, scenario) for (_, table), policy in zip((a, b), pair, strict=True)]
    if not all(each.num_rows for each in rows):
        return None
    counts = [each.num_rows for each in rows]
    seeds = [each.column("seed").to_numpy() for each in rows]
    common = np.intersect1d(seeds[0], seeds[1], return_indices=True)[1:]
    definitions = [next(s for s in m.scenarios if s.name == scenario) for m, _ in (a, b)]
    why_not = ""
    if definitions[0] != definitions[1]:
        why_not = f"{scenario} is not the same scenario in both"
    elif a[0].steps != b[0].steps:
        why_not = "their episodes are not of the same length"
    elif not len(common[0]):
        why_not = "their episodes have different seeds"
    else:  # in the order of A's
        rows = [each.take(places[common[0].argsort()]) for each, places in zip(rows, common, strict=True)]
    first, second = rows
    return Match(
        a=pair[0],
        b=pair[1],
        scenario=scenario,
        paired=not why_not,
        why_not=why_not,
        episodes=(counts[0], counts[1]),
        common=len(common[0]),
        identical=not why_not and _identical(first, second),
        contrasts=tuple(compare_samples(_values(first), _values(second), paired=not why_not)),
    )


def _values(rows: pa.Table) -> dict[str, Floats]:
    """Metric -> value of each episode, of those that the run has."""
    errors = {name: rows.column(name).to_numpy() for name in ERRORS if name in rows.column_names}
    rates = {FALL_RATE: rows.column("fell").to_numpy()}
    if "outcome" in rows.column_names:
        rates[SUCCESS_RATE] = rows.column("outcome").to_numpy() == SUCCEEDED
    return {name: held.astype(np.float64) for name, held in rates.items()} | errors


def _identical(a: pa.Table, b: pa.Table) -> bool:
    """Whether all measures that both have are the same, to the bit."""
    names = [name for name in a.column_names if name in b.column_names and name != "policy"]
    return all(repr(a.column(name).to_pylist()) == repr(b.column(name).to_pylist()) for name in names)


def _table(options: Options, matches: list[Match]) -> Table:
    title = f"B minus A, 95 % interval, uncorrected p\nA: {options.a}\nB: {options.b}"
    groups: dict[str, list[dict[str, str]]] = {match.scenario: [] for match in matches}
    for match in matches:
        name = match.a if match.a == match.b else f"{match.a} → {match.b}"
        mark = " (=)" if match.identical else "" if match.paired else " (unpaired)"
        shown = dict.fromkeys(METRICS, ABSENT) | {found.metric: _shown(found) for found in match.contrasts}
        groups[match.scenario].append({FIRST: row_name(f"{name}{mark}"), **shown})
    return console_table(escape(title), {FIRST: "policy", **NARROW_DIFFERENCES}, groups)


def _shown(found: MetricDifference) -> str:
    value, ends = (points, points_interval) if found.metric in RATES else (number, interval)
    return f"{value(found.difference)}\n{ends(found.ci)}\n{p_value(found.p_value)}"


def _notes(matches: list[Match], rules: tuple[str, str]) -> Iterator[str]:
    """How the episodes were compared, and by which rule of success where it is not today's in both."""
    paired = [match for match in matches if match.paired]
    if paired:
        yield "paired by episode: same seeds on the same scenario (exact McNemar, sign-flip permutation)"
    for common, (a, b) in dict.fromkeys((match.common, match.episodes) for match in paired):
        if {common} != {a, b}:
            yield f"of A's {counted(a, 'episode')} and B's {b}, the {common} of the same seeds are compared"
    for reason in dict.fromkeys(match.why_not for match in matches if not match.paired):
        yield f"unpaired, since {reason} (Barnard, permutation)"
    if same := sum(match.identical for match in matches):
        yield f"(=): the same to the bit in every episode; {same} of {len(matches)}"
    if rules[0] != rules[1]:
        old = "A" if rules[0] == SUCCESS_1 else "B"
        yield f"success and outcomes of both by {SUCCESS_RULE}: {old} ran under {SUCCESS_1} and was rescored, exactly"
    elif rules[0] != SUCCESS_RULE:
        yield f"success and outcomes of both by {rules[0]}, the older rule that they ran under"


def _left_out(a: tuple[Manifest, pa.Table], b: tuple[Manifest, pa.Table]) -> Iterator[str]:
    """What a run that is not finished has no episodes of yet."""
    for name, (manifest, rows) in (("A", a), ("B", b)):
        there = set(zip(rows.column("scenario").to_pylist(), rows.column("policy").to_pylist(), strict=True))
        if left := [f"{policy} on {each.name}" for each, policy in manifest.cells if (each.name, policy) not in there]:
            yield f"{name} is not finished, and left out of it are: {', '.join(left)}"


def _write(options: Options, matches: list[Match], changed: list[str], path: Path) -> None:
    contents: dict[str, Any] = {"schema": 1, "a": str(options.a), "b": str(options.b), "differences": changed}
    contents["comparisons"] = [asdict(match) for match in matches]
    try:
        write_atomically(path, (json.dumps(without_nan(contents), indent=2, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise UsageError(f"--json: cannot write {path} ({error.strerror})") from error
