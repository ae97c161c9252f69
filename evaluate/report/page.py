"""HTML page of the report of a run."""

from html import escape
from pathlib import Path
from typing import Any

from evaluate.analysis.results import Results
from evaluate.hardware import describe_hardware
from evaluate.report.html import breakable, collapsible, contents, note, section
from evaluate.report.plots import drawing
from evaluate.report.sections.axis_section import render_axes
from evaluate.report.sections.causes import render_causes
from evaluate.report.sections.effort import render_effort
from evaluate.report.sections.failures import render_failures
from evaluate.report.sections.figures import measure_definitions, policy_label
from evaluate.report.sections.overview import render_overview
from evaluate.report.sections.ranking import render_best_and_worst, render_ranking
from evaluate.report.sections.seed_groups import render_seed_groups
from evaluate.report.verdict import ranking_verdict
from policies.registry import shipped_summaries
from quad_env.cli.format import join_names, with_count
from quad_env.files.writing import write_atomically

NOTES = (
    "Every policy runs the same episodes: the same seeds, and thereby the same starts, commands, pushes and positions "
    "on the terrain. The seeds come from a family that training and parameter searches never draw from.",
    "All intervals are 95 % intervals. Rates of success and falls: Wilson. Scores: Wilson with the effective number "
    "of episodes (Korn and Graubard 1998). Means: bootstrap (BCa) over episodes; the cost of transport over the "
    "linearised values of the quotient (Woodruff 1971). Differences of rates: Tango's score interval. Differences "
    "of means: bootstrap over pairs (percentiles, widened to Student's t). If all episodes have the same value, "
    "other values up to the cap may have the upper limit of Wilson's interval for none of that number.",
    "The claims are the better policy of each adjacent pair in the ranking, and the scenarios on which an adjacent "
    "pair, or a policy and the baseline, differ in success. Tests are paired by episode and two-sided: sign-flip "
    "permutation for scores, exact McNemar for success. One correction covers all of these claims (Holm's method, "
    "with nine tenths of the weight for the ranking): the probability that any of them is false is at most 5 %. "
    "Each interval is uncorrected. The number of needed episodes distinguishes a difference of the observed size "
    "with a probability of 80 %.",
    "A breaking point is the severity at which a monotone regression crosses one half; the regression is straight over "
    "the logarithm of severity between the levels. Its interval follows from exact binomial tests.",
    "The intervals of a policy cover the variation of episodes, not of training: another training seed gives another "
    "policy. The intervals of a group of training seeds cover both.",
)
"""Explanations of the methods of the evaluation, for the end of the report."""
Origin = tuple[str, str]
"""Origin of a run: the command that started it, and the day of the start; a text is empty if it is unknown."""


def write_report(results: Results, path: Path, **about: Any) -> None:
    """Write the HTML report of a run (evaluation).

    Args:
        results: Results of the run.
        path: HTML file to write.
        **about: Keyword arguments of `render`, except `folder`.
    """
    write_atomically(path, render(results, folder=path.parent, **about).encode())


def render(results: Results, *, made_by: Origin = ("", ""), folder: Path = Path()) -> str:
    """Render the whole HTML report of a run.

    Args:
        results: Results of the run.
        made_by: Command that started the run, and the day of the start.
        folder: Folder of the report; the report links to the pages of episodes in it.

    Returns:
        HTML of the page.
    """
    css = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    with drawing.plot_settings():
        answers = [
            render_ranking(results),
            render_seed_groups(results),
            render_best_and_worst(results),
            render_causes(results),
            render_failures(results, folder),
            render_effort(results),
        ]
        axes = render_axes(results)
        details = [render_overview(results), contents(axes, "Axes"), axes, _about(results), _notes(results)]
    body = "".join([*answers, *details])
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>SimpleQuad: comparison of policies</title><style>{css}</style></head>\n<body>\n"
        f"{_head(results, made_by)}\n{contents(body.replace(axes, ''))}{body}</body></html>\n"
    )


def _head(results: Results, made_by: Origin) -> str:
    """Render the head of the report as HTML: best policy, size and origin of the run, and warnings."""
    interrupted = '<p class="warning">Interrupted: this page shows the part of the comparison that was done.</p>'
    warning = "" if results.complete else interrupted
    warning += "".join(f'<p class="warning">{escape(line)}.</p>' for line in list_warnings(results))
    command, date = map(escape, made_by)
    start = f", begun on {date}" if date else ""
    origin = f" Made by <code>{command}</code>{start}." if command else ""
    about = f"{escape(describe_extent(results))}. Seed {results.seed}.{describe_hardware(results.hardware)}{origin}"
    return f'<h1>{breakable(ranking_verdict(results.ranking))}</h1><p class="soft">{about}</p>{warning}'


def _about(results: Results) -> str:
    """Render the section of the report with a description of each policy, as HTML."""
    roles = {results.baseline: " <small>(baseline)</small>"} if len(results.policies) > 1 else {}
    summaries = shipped_summaries(results.policies, results.hardware.robot_model)
    descriptions = {name: f": {escape(text)}" for name, text in summaries.items()}
    entries = [
        f"<li>{policy_label(results, policy)}{roles.get(policy, '')}{descriptions.get(policy, '')}</li>"
        for policy in results.policies
    ]
    return section("Policies", f'<ul class="legend">{"".join(entries)}</ul>')


def _notes(results: Results) -> str:
    """Render the last section as HTML: notes on methods, definitions of measures, and software versions."""
    notes = "".join(f"<li>{escape(text)}</li>" for text in NOTES)
    made_with = "; ".join(f"{name} {version or 'unknown'}" for name, version in results.versions.items())
    return section(
        "How it was measured",
        f"<ul>{notes}</ul>",
        collapsible("Every measure: unit, frame, formula, source", measure_definitions(), printed=True),
        note(f"Made with {made_with}."),
        note("In the same folder: results.json (these figures), episodes.parquet (a row an episode)."),
    )


def list_warnings(results: Results) -> list[str]:
    """Return the warnings on a run: policies with errors, and an end by a sequential test or a time limit."""
    lines = [
        f"{errors.policy} failed in {errors.failed} of {with_count(errors.episodes, 'episode')}; "
        f"in the first it {errors.first}"
        for errors in results.policy_errors
    ]
    reason = results.provenance.get("ended")
    limit = results.provenance.get("limit", 0)
    if reason and results.provenance.get("minutes"):
        lines.append(
            f"This run ended after {results.episodes} of at most {limit} episodes: {reason}; the option --episodes "
            f"{results.episodes} in place of --minutes simulates the same episodes on every machine"
        )
    elif reason:
        lines.append(
            f"--until settled ended this run after {results.episodes} of at most {limit} episodes: {reason}, by a "
            "sequential test corrected for all looks; intervals are those of a fixed number of episodes"
        )
    return lines


def describe_extent(results: Results) -> str:
    """Return the size of a run in words, such as `64 episodes of each policy on each of 27 scenarios`."""
    scenarios_of = {
        policy: [scenario for scenario, other in results.summaries if other == policy] for policy in results.policies
    }
    partial = {policy: names for policy, names in scenarios_of.items() if len(names) < len(results.scenarios)}
    exceptions = [f"of {policy} on {join_names(names)} alone" for policy, names in partial.items() if results.complete]
    episodes = with_count(results.episodes, "episode")
    scenarios = with_count(len(results.scenarios), "scenario")
    return ", ".join([f"{episodes} of each policy on each of {scenarios}", *exceptions])
