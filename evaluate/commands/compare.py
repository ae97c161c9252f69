"""`python -m evaluate compare A B`: two results folders, such as those of two commits or of two machines."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape

from evaluate.analysis.comparison import METRICS, RATES, SIGNIFICANT, SUCCESS_RATE, MetricDifference
from evaluate.analysis.joint import CombinedRuns, combine_runs
from evaluate.analysis.matches import Match, StoredRun, match_runs, strip_hardware_suffix
from evaluate.analysis.rank_correlation import MIN_POLICIES, RankCorrelation
from evaluate.analysis.results import nan_to_null
from evaluate.records.manifest import Manifest, differences
from evaluate.records.store import read_rows
from evaluate.report.console import FittedTable, console_table, format_row_name
from evaluate.report.headings import MAIN_EFFORT_TITLES, ROW_LABEL, TERMINAL_DIFFERENCE_TITLES, estimate_effort
from evaluate.report.table import print_ranking
from evaluate.report.verdict import IDENTICAL_WORDS, INDISTINGUISHABLE_WORDS, UNCORRECTED_WORDS, excludes_zero
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import ABSENT, estimate, p_value, points, points_with, with_count
from quad_env.cli.progress import show_waiting
from quad_env.files.writing import write_atomically


@dataclass(frozen=True)
class CompareOptions:
    """What to compare."""

    a: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation, finished or not."""
    b: Annotated[Path, tyro.conf.Positional]
    """Another; differences are B minus A."""
    policies: tuple[str, str] | None = None
    """A policy of A and the policy of B to compare it with; by default every policy that both have."""
    json: Path | None = None
    """File for the figures."""


def main(options: CompareOptions) -> int:
    """Run the command; the exit code. Raises UsageError."""
    if options.json is not None:
        make_folder_of(options.json, "--json")
    a, b = map(_read, (options.a, options.b))
    pairs, changed = _pairs(options, a[0], b[0]), differences(a[0], b[0])
    if {each.name for each in a[0].scenarios}.isdisjoint(each.name for each in b[0].scenarios):
        changed = [*changed, "the hardware profile, which one of them has"]
        a, b = map(strip_hardware_suffix, (a, b))
    with show_waiting("comparing"):
        found: Sequence[Match] = match_runs(pairs, a, b)
        both = combine_runs(found, (a, b), _labels(options, found, a[0], b[0]))
    if not found and not both.ranking.places:
        what = "no scenario of these policies, or no episodes of the same --seed, in common"
        raise UsageError(f"{options.a} and {options.b} have {what}")
    console, found = Console(), both.matches
    print_ranking(both.ranking, console)
    for heads in (TERMINAL_DIFFERENCE_TITLES, MAIN_EFFORT_TITLES):
        if any(each.metric in heads for match in found for each in match.contrasts):
            console.print(_table(options, found, heads))
    said = [*_ranking_agreement(both.correlation, found), *_notes(a, b, found), *_left_out(a, b)]
    said.append(f"A and B differ in: {'; '.join(changed) or 'nothing that is known'}")
    console.print("\n".join(said), highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        _write(options, both, changed, options.json)
        console.print(str(options.json), highlight=False, markup=False, soft_wrap=True)
    return 0


def _read(path: Path) -> StoredRun:
    manifest, rows = read_rows(_folder(path))
    if not rows.num_rows:
        raise UsageError(f"{_folder(path)} holds no finished part of a comparison yet")
    return manifest, rows


def _folder(path: Path) -> Path:
    return path.parent if path.name in ("results.json", "episodes.parquet", "manifest.json") else path


def _pairs(options: CompareOptions, a: Manifest, b: Manifest) -> list[tuple[str, str]]:
    """Which policy of A goes with which of B. Raises UsageError."""
    if options.policies is not None:
        for policy, manifest, folder in zip(options.policies, (a, b), (options.a, options.b), strict=True):
            if policy not in manifest.policies:
                raise UsageError(f"--policies: {folder} has no {policy}, but {', '.join(manifest.policies)}")
        return [options.policies]
    if len(a.policies) == len(b.policies) == 1:
        return [(next(iter(a.policies)), next(iter(b.policies)))]
    return [(policy, policy) for policy in a.policies if policy in b.policies]


def _labels(
    options: CompareOptions, found: Sequence[Match], a: Manifest, b: Manifest
) -> tuple[dict[str, str], dict[str, str]]:
    """What the policies of A and of B are called: with the folder where both have that name, but once where all of its
    episodes are the same."""
    of_a, of_b = ((name,) for name in options.policies) if options.policies else (a.policies, b.policies)
    changed = {match.a for match in found if not match.identical}
    twice = {name for name in of_a if name in of_b and (name in changed or all(match.a != name for match in found))}
    paths = _folder(options.a).resolve(), _folder(options.b).resolve()
    folders = [str(each) if paths[0].name == paths[1].name else each.name for each in paths]
    one, other = (
        {name: f"{name} ({folder})" if name in twice else name for name in of}
        for of, folder in zip((of_a, of_b), folders, strict=True)
    )
    return one, other


def _ranking_agreement(ranked: RankCorrelation | None, found: Sequence[Match]) -> Iterator[str]:
    """Whether the ranking survives, and the cells of which success differs."""
    few = f"fewer than {MIN_POLICIES} policies ran every scenario of both: too few to rank"
    yield from ranked.lines() if ranked else (f"does the ranking survive? {few}",)
    for match in found:
        if match.p_value_holm < SIGNIFICANT:
            said = f"{points(match.contrasts[0].difference)} points, {p_value(match.p_value_holm)}"
            yield f"success differs: {match.a} on {match.scenario}, {said}"
    if unclear := [match for match in found if match.p_value_holm >= SIGNIFICANT and excludes_zero(_success(match).ci)]:
        named = (f"{match.a} on {match.scenario} ({p_value(match.p_value_holm)})" for match in unclear)
        yield f"success {INDISTINGUISHABLE_WORDS}, {UNCORRECTED_WORDS}: {', '.join(named)}"


def _success(match: Match) -> MetricDifference:
    return next(each for each in match.contrasts if each.metric == SUCCESS_RATE)


def _table(options: CompareOptions, found: Sequence[Match], heads: Mapping[str, str]) -> FittedTable:
    title = f"B minus A, 95 % interval, p of success corrected with all claims\nA: {options.a}\nB: {options.b}"
    groups: dict[str, list[dict[str, str]]] = {match.scenario: [] for match in found}
    for match in found:
        name = match.a if match.a == match.b else f"{match.a} → {match.b}"
        shown = dict.fromkeys((*METRICS, *MAIN_EFFORT_TITLES), ABSENT) | {
            each.metric: _shown(each, match.p_value_holm, match.identical) for each in match.contrasts
        }
        groups[match.scenario].append({ROW_LABEL: format_row_name(name + " (=)" * match.identical), **shown})
    return console_table(escape(title), {ROW_LABEL: "policy", **heads}, groups)


def _shown(found: MetricDifference, corrected: float, identical: bool) -> str:
    if identical:
        return "0"
    if found.metric in MAIN_EFFORT_TITLES:
        shown = estimate_effort(found.metric, found.difference, found.ci)
    else:
        shown = (points_with if found.metric in RATES else estimate)(found.difference, found.ci)
    claim = f"\n{p_value(corrected)}" if found.metric == SUCCESS_RATE else ""
    ends = shown.interval.replace("… ", "…\n")
    return f"{shown.value}\n{ends}{claim}"


def _notes(a: StoredRun, b: StoredRun, found: Sequence[Match]) -> Iterator[str]:
    """How the episodes were compared."""
    seeds = [{*rows.column("seed").to_pylist()} for _, rows in (a, b)]
    count = with_count(len(seeds[0] & seeds[1]), "episode")
    yield f"paired by episode: {count} of the same seeds, of A's {len(seeds[0])} and B's {len(seeds[1])}"
    if same := sum(match.identical for match in found):
        of_matches = f"{same} of {len(found)}"
        yield f"(=): {IDENTICAL_WORDS} in every episode, so that differences are 0 and have no interval; {of_matches}"


def _left_out(a: StoredRun, b: StoredRun) -> Iterator[str]:
    """What a run that is not finished has no episodes of yet."""
    for name, (manifest, rows) in (("A", a), ("B", b)):
        there = set(zip(rows.column("scenario").to_pylist(), rows.column("policy").to_pylist(), strict=True))
        if left := [f"{policy} on {each.name}" for each, policy in manifest.cells if (each.name, policy) not in there]:
            yield f"{name} is not finished, and left out of it are: {', '.join(left)}"


def _write(options: CompareOptions, both: CombinedRuns, changed: list[str], path: Path) -> None:
    contents = {"schema": 1, "a": str(options.a), "b": str(options.b), "differences": changed}
    contents |= {"ranking": asdict(both.ranking), "comparisons": [asdict(match) for match in both.matches]}
    contents |= {"rank_correlation": asdict(both.correlation) if both.correlation else None}
    try:
        write_atomically(path, (json.dumps(nan_to_null(contents), indent=2, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise UsageError(f"--json: cannot write {path} ({error.strerror})") from error
