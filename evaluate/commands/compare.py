"""`python -m evaluate compare A B`: compare two results folders, for example of two commits."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape

from evaluate.analysis.combined_runs import CombinedRuns, combine_runs
from evaluate.analysis.comparison import METRICS, RATES, SIGNIFICANT, SUCCESS_RATE, MetricDifference
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
    """Two results folders, and the policies to compare."""

    a: Annotated[Path, tyro.conf.Positional]
    """Results folder A of an evaluation, finished or not."""
    b: Annotated[Path, tyro.conf.Positional]
    """Results folder B of another evaluation; differences are B minus A."""
    policies: tuple[str, str] | None = None
    """A policy of run A, and a policy of run B to compare it with; by default every policy that both runs have."""
    json: Path | None = None
    """JSON file to write, with the differences and the combined ranking."""


def main(options: CompareOptions) -> int:
    """Compare the two runs in the `options`; return the exit code 0.

    UsageError is raised if the runs cannot be compared.
    """
    if options.json is not None:
        make_folder_of(options.json, "--json")
    a = _read(options.a)
    b = _read(options.b)
    pairs = _pairs(options, a[0], b[0])
    changes = differences(a[0], b[0])
    if {scenario.name for scenario in a[0].scenarios}.isdisjoint(scenario.name for scenario in b[0].scenarios):
        changes.append("the hardware profile, which one of them has")
        a = strip_hardware_suffix(a)
        b = strip_hardware_suffix(b)
    with show_waiting("comparing"):
        matches = match_runs(pairs, a, b)
        both = combine_runs(matches, (a, b), _labels(options, matches, a[0], b[0]))
    if not matches and not both.ranking.places:
        reason = "no scenario of these policies, or no episodes of the same --seed, in common"
        raise UsageError(f"{options.a} and {options.b} have {reason}")
    console = Console()
    _print_tables(options, both, console)
    lines = [*_ranking_agreement(both.correlation, both.matches), *_notes(a, b, both.matches), *_unfinished(a, b)]
    lines.append(f"A and B differ in: {'; '.join(changes) or 'nothing that is known'}")
    console.print("\n".join(lines), highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        _write(options, both, changes, options.json)
        console.print(str(options.json), highlight=False, markup=False, soft_wrap=True)
    return 0


def _print_tables(options: CompareOptions, both: CombinedRuns, console: Console) -> None:
    """Print the combined ranking of the policies of both runs, and tables of the runs' differences."""
    print_ranking(both.ranking, console)
    metrics = {contrast.metric for match in both.matches for contrast in match.contrasts}
    for titles in (TERMINAL_DIFFERENCE_TITLES, MAIN_EFFORT_TITLES):
        if not metrics.isdisjoint(titles):
            console.print(_table(options, both.matches, titles))


def _read(path: Path) -> StoredRun:
    """Read the manifest and the episode table of the run (evaluation) at `path`.

    Args:
        path: Results folder, or a file in this folder.

    Returns:
        Manifest (inputs of the run), and table of the run with one row for each episode.

    Raises:
        UsageError: The run has no policy with all of its episodes on a scenario yet.
    """
    manifest, rows = read_rows(_folder(path))
    if not rows.num_rows:
        raise UsageError(f"{_folder(path)} holds no finished part of a comparison yet")
    return manifest, rows


def _folder(path: Path) -> Path:
    """Return the results folder for a `path` that names the folder or one of its files."""
    return path.parent if path.name in ("results.json", "episodes.parquet", "manifest.json") else path


def _pairs(options: CompareOptions, a: Manifest, b: Manifest) -> list[tuple[str, str]]:
    """Return the pairs of policies to compare: a policy of run A and a policy of run B.

    Args:
        options: Options of the command line.
        a: Manifest of run A.
        b: Manifest of run B.

    Returns:
        The pair that the options name. If the options name none and each run has only one policy, it is the pair of
        these two policies. In all other cases, there is one pair for each policy that both runs have.

    Raises:
        UsageError: A run does not have the named policy.
    """
    if options.policies is not None:
        for policy, manifest, folder in zip(options.policies, (a, b), (options.a, options.b), strict=True):
            if policy not in manifest.policies:
                raise UsageError(f"--policies: {folder} has no {policy}, but {', '.join(manifest.policies)}")
        return [options.policies]
    if len(a.policies) == len(b.policies) == 1:
        return [(next(iter(a.policies)), next(iter(b.policies)))]
    return [(policy, policy) for policy in a.policies if policy in b.policies]


def _labels(
    options: CompareOptions, matches: Sequence[Match], a: Manifest, b: Manifest
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the display names of the policies of run A and of run B.

    If both runs have a policy of the same name, the name of the results folder is added to distinguish the two
    policies. The folder is not added if all episodes of the two policies are identical.

    Args:
        options: Options of the command line.
        matches: Comparisons of the policies of the two runs on each common scenario.
        a: Manifest of run A.
        b: Manifest of run B.

    Returns:
        A dictionary for run A, and a dictionary for run B: name of a policy -> display name.
    """
    names_a, names_b = ((name,) for name in options.policies) if options.policies else (a.policies, b.policies)
    changed = {match.a for match in matches if not match.identical}
    matched = {match.a for match in matches}
    ambiguous = {name for name in names_a if name in names_b and (name in changed or name not in matched)}
    paths = (_folder(options.a).resolve(), _folder(options.b).resolve())
    folders = [str(path) if paths[0].name == paths[1].name else path.name for path in paths]
    return _display_names(names_a, ambiguous, folders[0]), _display_names(names_b, ambiguous, folders[1])


def _display_names(names: Iterable[str], ambiguous: Set[str], folder: str) -> dict[str, str]:
    """Return policy name -> display name for `names`; the results `folder` is added to `ambiguous` names."""
    return {name: f"{name} ({folder})" if name in ambiguous else name for name in names}


def _ranking_agreement(correlation: RankCorrelation | None, matches: Sequence[Match]) -> Iterator[str]:
    """Yield lines of text on the agreement of two runs: equal ranking, significant differences.

    The first lines show if both runs rank the policies in the same order. The other lines name the policies and
    scenarios with a significant difference in success rate.

    Args:
        correlation: Rank correlation of the policies between the runs; None if too few policies are ranked.
        matches: Comparisons of the policies of the two runs on each common scenario.

    Yields:
        Lines of text.
    """
    if correlation:
        yield from correlation.lines()
    else:
        few = f"fewer than {MIN_POLICIES} policies ran every scenario of both: too few to rank"
        yield f"does the ranking survive? {few}"
    for match in matches:
        if match.p_value_holm < SIGNIFICANT:
            difference = f"{points(match.contrasts[0].difference)} points, {p_value(match.p_value_holm)}"
            yield f"success differs: {match.a} on {match.scenario}, {difference}"
    unclear = [match for match in matches if match.p_value_holm >= SIGNIFICANT and excludes_zero(_success(match).ci)]
    if unclear:
        names = [f"{match.a} on {match.scenario} ({p_value(match.p_value_holm)})" for match in unclear]
        yield f"success {INDISTINGUISHABLE_WORDS}, {UNCORRECTED_WORDS}: {', '.join(names)}"


def _success(match: Match) -> MetricDifference:
    """Return the difference in success rate, run B minus run A, of a pair of policies on a scenario."""
    return next(contrast for contrast in match.contrasts if contrast.metric == SUCCESS_RATE)


def _table(options: CompareOptions, matches: Sequence[Match], titles: Mapping[str, str]) -> FittedTable:
    """Make the terminal table of the differences between two runs (evaluations).

    Args:
        options: Options of the command line.
        matches: Comparisons of the policies of the two runs on each common scenario.
        titles: Name of a metric -> title of its column.

    Returns:
        A table with a group of rows for each scenario, and a row for each pair of policies.
    """
    title = f"B minus A, 95 % interval, p of success corrected with all claims\nA: {options.a}\nB: {options.b}"
    groups: dict[str, list[dict[str, str]]] = {match.scenario: [] for match in matches}
    for match in matches:
        name = match.a if match.a == match.b else f"{match.a} → {match.b}"
        if match.identical:
            name += " (=)"
        entries = dict.fromkeys((*METRICS, *MAIN_EFFORT_TITLES), ABSENT)
        for contrast in match.contrasts:
            entries[contrast.metric] = _entry(contrast, match.p_value_holm, match.identical)
        groups[match.scenario].append({ROW_LABEL: format_row_name(name), **entries})
    return console_table(escape(title), {ROW_LABEL: "policy", **titles}, groups)


def _entry(contrast: MetricDifference, corrected_p_value: float, identical: bool) -> str:
    """Format a difference for a table: value, 95 % interval and, for the success rate, the p-value.

    Args:
        contrast: Difference of one metric between the runs, with its interval.
        corrected_p_value: p-value of the difference in success rate, corrected for the number of tests.
        identical: True if all episodes of the two compared policies are bit-identical.

    Returns:
        Text with line breaks; `0` for identical episodes.
    """
    if identical:
        return "0"
    if contrast.metric in MAIN_EFFORT_TITLES:
        shown = estimate_effort(contrast.metric, contrast.difference, contrast.ci)
    elif contrast.metric in RATES:
        shown = points_with(contrast.difference, contrast.ci)
    else:
        shown = estimate(contrast.difference, contrast.ci)
    claim = f"\n{p_value(corrected_p_value)}" if contrast.metric == SUCCESS_RATE else ""
    interval = shown.interval.replace("… ", "…\n")
    return f"{shown.value}\n{interval}{claim}"


def _notes(a: StoredRun, b: StoredRun, matches: Sequence[Match]) -> Iterator[str]:
    """Yield lines of text on the episodes with equal seeds in both runs, and on identical results.

    `matches` are the comparisons of the policies on each common scenario.
    """
    seeds_a, seeds_b = ({*rows.column("seed").to_pylist()} for _, rows in (a, b))
    count = with_count(len(seeds_a & seeds_b), "episode")
    yield f"paired by episode: {count} of the same seeds, of A's {len(seeds_a)} and B's {len(seeds_b)}"
    if num_identical := sum(match.identical for match in matches):
        share = f"{num_identical} of {len(matches)}"
        yield f"(=): {IDENTICAL_WORDS} in every episode, so that differences are 0 and have no interval; {share}"


def _unfinished(a: StoredRun, b: StoredRun) -> Iterator[str]:
    """Yield a line of text for each unfinished run, with the policies and scenarios that are missing."""
    for name, (manifest, rows) in (("A", a), ("B", b)):
        stored = set(zip(rows.column("scenario").to_pylist(), rows.column("policy").to_pylist(), strict=True))
        cells = [(scenario.name, policy) for scenario, policy in manifest.cells]
        if missing := [f"{policy} on {scenario}" for scenario, policy in cells if (scenario, policy) not in stored]:
            yield f"{name} is not finished, and left out of it are: {', '.join(missing)}"


def _write(options: CompareOptions, both: CombinedRuns, changes: list[str], path: Path) -> None:
    """Write the comparison of two runs as a JSON file.

    Args:
        options: Options of the command line.
        both: Results of both runs together.
        changes: Descriptions of the inputs that differ between the runs, for example the code.
        path: File to write.

    Raises:
        UsageError: The file cannot be written.
    """
    contents = {
        "schema": 1,
        "a": str(options.a),
        "b": str(options.b),
        "differences": changes,
        "ranking": asdict(both.ranking),
        "comparisons": [asdict(match) for match in both.matches],
        "rank_correlation": asdict(both.correlation) if both.correlation else None,
    }
    try:
        write_atomically(path, (json.dumps(nan_to_null(contents), indent=2, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise UsageError(f"--json: cannot write {path} ({error.strerror})") from error
