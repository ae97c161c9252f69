"""`report.html`: one page that opens offline, on a phone and in print; the outcome in words comes first."""

import base64
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path

from evaluate import plots
from evaluate.comparison import ERRORS, FALL_RATE, Comparison
from evaluate.format import counted, interval, listed, number, p_value, percent_interval, points, points_interval
from evaluate.results import Results
from evaluate.summary import Summary
from evaluate.table import against_baseline, baseline_of
from evaluate.verdict import headline, verdict
from policies.files import write_atomically

HEADINGS = {
    FALL_RATE: ("falls", ""),
    "velocity_error": ("velocity error", "m/s"),
    "mean_velocity_error": ("mean velocity error", "m/s"),
    "yaw_rate_error": ("yaw-rate error", "rad/s"),
}

NOTES = (
    "Every policy runs the same episodes: the same seeds, and so the same starts, commands, pushes and places on the "
    "terrain. They come from a family of seeds that training and parameter searches never draw from.",
    "Velocity and yaw-rate error are means over the control steps after an episode's first second, in the heading "
    "frame. A step's error is capped at 2 m/s and 3 rad/s, and every step from a fall to the time limit counts the "
    "cap, so that falling early never pays.",
    "Mean velocity error compares the command with the mean velocity over each command interval after its first "
    "second: a gait is not billed for swaying within a stride. Falls are billed likewise.",
    "A divergence of the simulation counts as a fall. A time-out does not.",
    "Cost of transport is the energy of all episodes, ∑|torque · joint speed| before a fall, over weight times "
    "distance, where the distance of a command interval is its time times its mean planar speed: swaying on the spot "
    "covers none.",
    "Intervals are 95 %: Wilson for falls, bootstrap (BCa) over episodes for means. Tests are paired by episode and "
    "two-sided: exact McNemar for falls, sign-flip permutation for means. Each stands by itself; among many "
    "comparisons, one in twenty comes out below p = 0.05 by chance alone.",
    "The intervals speak of episodes, not of training: another training seed gives another policy.",
)


def write_report(results: Results, path: Path) -> None:
    """Write report.html."""
    with plots.settings():
        write_atomically(path, render(results).encode())


def render(results: Results) -> str:
    """The whole page."""
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    sections = (_verdict(results), _tables(results), _plots(results), _response(results), _notes(results))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>SimpleQuad: comparison of policies</title><style>{style}</style></head>\n<body>\n"
        f"{_head(results)}\n{''.join(sections)}</body></html>\n"
    )


def _head(results: Results) -> str:
    warning = (
        ""
        if results.complete
        else ('<p class="warning">Interrupted: this page shows the part of the comparison that was done.</p>')
    )
    return (
        f"<h1>{escape(listed(results.policies))} on {escape(listed(results.scenarios))}</h1>"
        f'<p class="soft">{counted(results.episodes, "episode")} of each policy on each scenario, '
        f"seed {results.seed}</p>{warning}"
    )


def _verdict(results: Results) -> str:
    first = "".join(f"<p><strong>{escape(sentence)}</strong></p>" for sentence in headline(results))
    entries = "".join(
        f"<dt>{_mark(results, policy)}{escape(policy)}{_role(results, policy)}</dt>"
        + "".join(f"<dd>{escape(sentence)}</dd>" for sentence in sentences)
        for policy, sentences in verdict(results)
    )
    return f'<section><h2>Outcome</h2>{first}<dl class="verdict">{entries}</dl></section>\n'


def _role(results: Results, policy: str) -> str:
    return " <small>(baseline)</small>" if policy == baseline_of(results) and len(results.policies) > 1 else ""


def _tables(results: Results) -> str:
    parts = [
        '<section><h2>Figures</h2><p class="note">Below each figure its 95 % interval. Shaded: the smallest error.</p>'
    ]
    baseline = baseline_of(results)
    for scenario in results.scenarios:
        parts.append(f"<h3>{_title(results, scenario)}</h3>{_summary_table(results, scenario)}")
        shown = [comparison for comparison in against_baseline(results) if comparison.scenario == scenario]
        if shown:
            parts.append(f'<p class="note">Minus {escape(baseline)}, paired by episode; below zero is better.</p>')
            parts.append(_comparison_table(shown))
    others = [comparison for comparison in results.comparisons if comparison.b != baseline]
    if others:
        parts.append(f"<details><summary>Every other pair of policies</summary>{_other_pairs(others)}</details>")
    return f"{''.join(parts)}</section>\n"


def _summary_table(results: Results, scenario: str) -> str:
    rows = {policy: s for (name, policy), s in results.summaries.items() if name == scenario}
    best = {metric: min(getattr(summary, metric) for summary in rows.values()) for metric in ERRORS}
    heads = [*HEADINGS.values(), ("cost of transport", ""), ("diverged", "")]
    body = (
        [f"{_mark(results, policy)}{_name(policy)}", *_summary_cells(summary, best)] for policy, summary in rows.items()
    )
    return _table(["policy", *(_heading(*head) for head in heads)], body)


def _summary_cells(summary: Summary, best: dict[str, float]) -> Iterator[str]:
    yield f"{summary.falls}&nbsp;of&nbsp;{summary.episodes}<small>{percent_interval(summary.fall_rate_ci)}</small>"
    for metric in list(HEADINGS)[1:]:
        value, ci = getattr(summary, metric), getattr(summary, f"{metric}_ci")
        text = f"{number(value)}<small>{interval(ci)}</small>"
        yield f"!{text}" if value == best[metric] else text
    yield number(summary.cost_of_transport, 2)
    yield str(summary.diverged)


def _comparison_table(comparisons: list[Comparison]) -> str:
    rows: dict[str, dict[str, str]] = {}
    for comparison in comparisons:
        rows.setdefault(comparison.a, {})[comparison.metric] = _difference(comparison)
    body = ([_name(policy), *(cells[metric] for metric in HEADINGS)] for policy, cells in rows.items())
    return _table(["policy", *_difference_heads()], body)


def _other_pairs(comparisons: list[Comparison]) -> str:
    rows: dict[tuple[str, str, str], dict[str, str]] = {}
    for c in comparisons:
        rows.setdefault((c.scenario, c.a, c.b), {})[c.metric] = _difference(c)
    body = (
        [f"{_name(a)} − {_name(b)}<small>{escape(scenario)}</small>", *(cells[metric] for metric in HEADINGS)]
        for (scenario, a, b), cells in rows.items()
    )
    return _table(["pair", *_difference_heads()], body)


def _difference_heads() -> list[str]:
    units = HEADINGS | {FALL_RATE: ("falls", "% points")}
    return [_heading(*head) for head in units.values()]


def _difference(comparison: Comparison) -> str:
    falls = comparison.metric == FALL_RATE
    value = points(comparison.difference) if falls else number(comparison.difference)
    ci = points_interval(comparison.ci) if falls else interval(comparison.ci)
    return f"{value}<small>{ci}</small><small>{escape(p_value(comparison.p_value))}</small>"


def _plots(results: Results) -> str:
    columns = len(results.scenarios)
    falls = (
        _image(plots.intervals(results, s, "fall_rate", "episodes with a fall, %", 100.0), f"Fall rates on {s}")
        for s in results.scenarios
    )
    errors = (
        _image(plots.intervals(results, s, "velocity_error", "velocity error, m/s"), f"Velocity errors on {s}")
        for s in results.scenarios
    )
    section = (
        f'<section><h2>Falls</h2><p class="note">With 95 % Wilson intervals.</p>{_grid(falls, columns)}</section>\n'
        f'<section><h2>Velocity error</h2><p class="note">Means with 95 % intervals.</p>{_grid(errors, columns)}'
        "</section>\n"
    )
    return section + _paired_plots(results)


def _paired_plots(results: Results) -> str:
    baseline = baseline_of(results)
    images = [
        _image(plots.paired(results, c.scenario, c.a, c.b), f"{c.a} against {c.b} on {c.scenario}, episode by episode")
        for c in against_baseline(results)
        if c.metric == "velocity_error"
    ]
    if not images:
        return ""
    return (
        '<section><h2>Episode by episode</h2><p class="note">Velocity error of each episode, '
        f"{escape(baseline)} across, the other policy up: below the line the other policy did better.</p>"
        f"{_grid(images, len(results.policies) - 1)}</section>\n"
    )


def _response(results: Results) -> str:
    scenario = results.scenarios[0]
    images = (
        _image(plots.response(results, scenario, policy, axis), f"Mean against commanded {name} of {policy}")
        for policy in results.policies
        if plots.stands_on(results, scenario, policy)
        for axis, (name, _) in enumerate(plots.AXES)
    )
    return (
        f'<section><h2>Speed response on {escape(scenario)}</h2><p class="note">A point is a command interval that '
        "the robot ended upright: the mean over it, after its first second, against the command. On the line it did as "
        f"told.</p>{_grid(images, len(plots.AXES))}</section>\n"
    )


def _notes(results: Results) -> str:
    notes = "".join(f"<li>{escape(note)}</li>" for note in NOTES)
    made_with = "; ".join(
        f"{escape(name)} {escape(version or 'unknown')}" for name, version in results.versions.items()
    )
    return (
        f'<section><h2>How it was measured</h2><ul>{notes}</ul><p class="note">Made with {made_with}.</p>'
        '<p class="note">Beside this page: results.json (these figures), episodes.parquet (a row an episode).</p>'
        "</section>\n"
    )


def _title(results: Results, scenario: str) -> str:
    cell = next(cell for cell in results.cells if cell.scenario.name == scenario)
    unit = cell.scenario.severity_unit
    severity = f" <small>({cell.scenario.severity:g} {escape(unit)})</small>" if unit else ""
    return f"{escape(scenario)}{severity}"


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of ready HTML; a cell that starts with `!` is shaded."""
    head = "".join(f"<th>{text}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cell(text: str) -> str:
    return f'<td class="best">{text[1:]}</td>' if text.startswith("!") else f"<td>{text}</td>"


def _heading(name: str, unit: str) -> str:
    return f"{name}<small>{unit}</small>" if unit else name


def _name(policy: str) -> str:
    """A policy's name that may break where a phone needs it to."""
    return escape(policy).replace("_", "_<wbr>").replace("/", "/<wbr>")


def _mark(results: Results, policy: str) -> str:
    return f'<span class="mark" style="background:{plots.style(results, policy)[0]}"></span>'


def _image(svg: bytes, description: str) -> str:
    source = base64.b64encode(svg).decode()
    return f'<img alt="{escape(description)}" src="data:image/svg+xml;base64,{source}">'


def _grid(images: Iterable[str], columns: int) -> str:
    """Images in so many columns; on a phone one below the other."""
    return f'<div class="plots" style="--columns: {max(2, min(columns, 4))}">{"".join(images)}</div>'
