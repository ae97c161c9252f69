"""`python -m evaluate compare A B`: two results folders, such as those of two commits or of two machines."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from evaluate.terminal.command_line import UsageError, make_folder_of

if TYPE_CHECKING:
    import pyarrow as pa
    from rich.table import Table

    from evaluate.analysis.run_comparison import MetricDifference, Sample
    from evaluate.records.manifest import Manifest


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
    identical: bool
    """Every column of every episode is the same to the bit."""
    contrasts: "tuple[MetricDifference, ...]" = field(default=())


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    from rich.console import Console

    from evaluate.records.manifest import differences

    if options.json is not None:
        make_folder_of(options.json, "--json")
    (manifest_a, rows_a), (manifest_b, rows_b) = map(_read, (options.a, options.b))
    pairs = _pairs(options, manifest_a, manifest_b)
    matches = [
        _match(scenario, pair, (manifest_a, rows_a), (manifest_b, rows_b))
        for scenario in _scenarios(rows_a, rows_b)
        for pair in pairs
        if all(_has(rows, policy, scenario) for rows, policy in zip((rows_a, rows_b), pair, strict=True))
    ]
    if not matches:
        raise UsageError(f"{options.a} and {options.b} have no scenario of these policies in common")
    console, changed = Console(), differences(manifest_a, manifest_b)
    console.print(_table(options, matches))
    for line in (*_notes(matches), f"A and B differ in: {'; '.join(changed) or 'nothing that is known'}"):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        _write(options, matches, changed)
        console.print(str(options.json), highlight=False, markup=False, soft_wrap=True)
    return 0


def _read(path: Path) -> "tuple[Manifest, pa.Table]":
    from evaluate.records.store import read_rows

    folder = path.parent if path.name in ("results.json", "episodes.parquet", "manifest.json") else path
    manifest, rows = read_rows(folder)
    if not rows.num_rows:
        raise UsageError(f"{folder} holds no finished part of a comparison yet")
    return manifest, rows


def _pairs(options: Options, a: "Manifest", b: "Manifest") -> list[tuple[str, str]]:
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


def _scenarios(a: "pa.Table", b: "pa.Table") -> list[str]:
    there = set(b.column("scenario").to_pylist())
    return [name for name in dict.fromkeys(a.column("scenario").to_pylist()) if name in there]


def _has(rows: "pa.Table", policy: str, scenario: str) -> bool:
    return bool(_select(rows, policy, scenario).num_rows)


def _select(rows: "pa.Table", policy: str, scenario: str) -> "pa.Table":
    import pyarrow.compute as pc

    mine = rows.filter(pc.equal(rows.column("scenario"), scenario))
    return mine.filter(pc.equal(mine.column("policy"), policy))


def _match(
    scenario: str, pair: tuple[str, str], a: "tuple[Manifest, pa.Table]", b: "tuple[Manifest, pa.Table]"
) -> Match:
    import numpy as np

    from evaluate.analysis.run_comparison import compare_samples

    rows = [_select(table, policy, scenario) for (_, table), policy in zip((a, b), pair, strict=True)]
    first, second = map(_sample, rows)
    definitions = [next(s for s in m.scenarios if s.name == scenario) for m, _ in (a, b)]
    why_not = ""
    if definitions[0] != definitions[1]:
        why_not = f"{scenario} is not the same scenario in both"
    elif a[0].steps != b[0].steps:
        why_not = "their episodes are not of the same length"
    elif not np.array_equal(first.seeds, second.seeds):
        why_not = "their episodes have different seeds"
    found = tuple(compare_samples(first, second, paired=not why_not))
    return Match(*pair, scenario, not why_not, why_not, not why_not and _identical(*rows), found)


def _sample(rows: "pa.Table") -> "Sample":
    from evaluate.analysis.comparison import ERRORS
    from evaluate.analysis.run_comparison import Sample

    errors = {name: rows.column(name).to_numpy() for name in ERRORS if name in rows.column_names}
    return Sample(rows.column("seed").to_numpy(), rows.column("fell").to_numpy(), errors)


def _identical(a: "pa.Table", b: "pa.Table") -> bool:
    """Whether all measures that both have are the same, to the bit."""
    names = [name for name in a.column_names if name in b.column_names and name != "policy"]
    return all(repr(a.column(name).to_pylist()) == repr(b.column(name).to_pylist()) for name in names)


def _table(options: Options, matches: list[Match]) -> "Table":
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from evaluate.analysis.comparison import ERRORS, FALL_RATE

    title = f"B minus A, 95 % interval, uncorrected p; below zero B is better\nA: {options.a}\nB: {options.b}"
    table = Table(
        title=escape(title),
        title_justify="left",
        title_style="",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    for name in ("policy", "falls\n% points", "velocity\nerror m/s", "yaw-rate\nerror rad/s", "mean vel.\nerror m/s"):
        table.add_column(name, justify="left" if name == "policy" else "right", overflow="fold")
    for scenario in dict.fromkeys(match.scenario for match in matches):
        table.add_row(f"[bold]{escape(scenario)}[/bold]")
        for match in (match for match in matches if match.scenario == scenario):
            name = match.a if match.a == match.b else f"{match.a} → {match.b}"
            shown = {found.metric: _shown(found) for found in match.contrasts}
            mark = " (=)" if match.identical else "" if match.paired else " (unpaired)"
            table.add_row(f" {escape(name)}{mark}", *(shown.get(metric, "–") for metric in (FALL_RATE, *ERRORS)))
    return table


def _shown(found: "MetricDifference") -> str:
    from evaluate.analysis.comparison import FALL_RATE
    from evaluate.terminal.format import interval, number, p_value, points, points_interval

    falls = found.metric == FALL_RATE
    value, ends = (points, points_interval) if falls else (number, interval)
    return f"{value(found.difference)}\n{ends(found.ci)}\n{p_value(found.p_value)}"


def _notes(matches: list[Match]) -> Iterator[str]:
    """How the episodes were compared."""
    if any(match.paired for match in matches):
        yield "paired by episode: same seeds on the same scenario (exact McNemar, sign-flip permutation)"
    for reason in dict.fromkeys(match.why_not for match in matches if not match.paired):
        yield f"unpaired, since {reason} (Barnard, permutation)"
    same = sum(match.identical for match in matches)
    if same:
        yield f"(=): the same to the bit in every episode; {same} of {len(matches)}"


def _write(options: Options, matches: list[Match], changed: list[str]) -> None:
    from evaluate.analysis.results import without_nan
    from policies.files import write_atomically

    contents: dict[str, Any] = {"schema": 1, "a": str(options.a), "b": str(options.b), "differences": changed}
    contents["comparisons"] = [asdict(match) for match in matches]
    assert options.json is not None
    try:
        text = json.dumps(without_nan(contents), indent=2, allow_nan=False) + "\n"
        write_atomically(options.json, text.encode())
    except OSError as error:
        raise UsageError(f"--json: cannot write {options.json} ({error.strerror})") from error
