"""The whole page, section by section."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from evaluate.analysis.gates import GateResult
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.measures.effort import ENERGY_1, ENERGY_RULE
from evaluate.measures.outcomes import SUCCESS_RULE
from evaluate.report.html import contents, fold, note, section
from evaluate.report.plots import drawing
from evaluate.report.sections.axis_section import disturbances
from evaluate.report.sections.effort import effort
from evaluate.report.sections.failures import failures
from evaluate.report.sections.figures import definitions, policy_label
from evaluate.report.sections.overview import overview, success
from evaluate.rollouts.hardware import words as words_of
from policies.summaries import explained
from quad_env.cli.format import counted, listed
from quad_env.files.writing import write_atomically
from quad_env.scenarios.scenario import HARDWARE

NOTES = (
    "Every policy runs the same episodes: the same seeds, and so the same starts, commands, pushes and places on the "
    "terrain. They come from a family of seeds that training and parameter searches never draw from.",
    "Intervals are 95 %: Wilson for successes and falls, for scores Wilson with the effective number of episodes (Korn "
    "and Graubard 1998), bootstrap (BCa) over episodes for means (of the cost of transport "
    "over the quotient's linearised values, Woodruff 1971), Tango's score interval for differences of successes "
    "and falls, bootstrap over pairs (percentiles, widened to Student's t) for those of means. Where all episodes "
    "agree, others may have the share that Wilson's interval has for none of so many, and any value up to the cap.",
    "Tests are paired by episode and two-sided: exact McNemar for falls, sign-flip permutation for means. p-values are "
    "corrected by Holm's method, metric by metric, over the comparisons with the baseline on every scenario of the "
    "run; those of the other pairs are families of their own. With those below 0.05 claimed, the chance of any "
    "false claim in a family is at most 5 %. Where p is larger there may still be a difference that so many episodes "
    "cannot show.",
    "A breaking point is where a monotone regression, straight over the logarithm of severity between the levels, "
    "crosses one half. No shape is assumed. What fewer and more are is shown by exact binomial tests.",
    "The intervals speak of episodes, not of training: another training seed gives another policy.",
)
Origin = tuple[str, str]
"""Command and day that a run was begun by and on; each empty where it is not known."""


def write_report(results: Results, path: Path, **about: Any) -> None:
    """Write report.html; `about` as of `render`."""
    write_atomically(path, render(results, folder=path.parent, **about).encode())


def render(
    results: Results, *, gates: Sequence[GateResult] = (), made_by: Origin = ("", ""), folder: Path = Path()
) -> str:
    """The whole page, to be in that folder."""
    css = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    with drawing.settings():
        sections = [
            success(results),
            failures(results, folder),
            effort(results),
            _gates(gates),
            overview(results),
            disturbances(results),
            _notes(results),
        ]
    body = "".join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>SimpleQuad: comparison of policies</title><style>{css}</style></head>\n<body>\n"
        f"{_head(results, made_by)}\n{contents(body)}{body}</body></html>\n"
    )


def _head(results: Results, made_by: Origin) -> str:
    interrupted = '<p class="warning">Interrupted: this page shows the part of the comparison that was done.</p>'
    warning = "" if results.complete else interrupted
    warning += "".join(f'<p class="warning">{escape(line)}.</p>' for line in warnings(results))
    names = [escape(axis.name) for axis in severity_axes(results.cells) if not axis.name.endswith(HARDWARE)]
    axes = listed(names) if names else ""
    real = sum(cell.scenario.hardware for cell in {cell.scenario.name: cell for cell in results.cells}.values())
    axes += f"{', ' if axes else ''}{counted(real, 'scenario')} with the hardware profile" if real else ""
    command, date = map(escape, made_by)
    begun = f", begun on {date}" if date else ""
    made = f'<p class="soft">Made by <code>{command}</code>{begun}.</p>' if command else ""
    roles = {results.baseline: " <small>(baseline)</small>"} if len(results.policies) > 1 else {}
    about = {name: f": {escape(text)}" for name, text in explained(results.policies).items()}
    legend = "".join(
        f"<li>{policy_label(results, name)}{roles.get(name, '')}{about.get(name, '')}</li>" for name in results.policies
    )
    return (
        f"<h1>{escape(listed(results.policies))}</h1>"
        f'<p class="soft">{escape(extent(results))}: {axes}. Seed {results.seed}.'
        f"{words_of(results.hardware)}</p>{made}{warning}"
        f'<ul class="legend">{legend}</ul>'
    )


def _gates(gates: Sequence[GateResult]) -> str:
    """A line a gate; empty without gates."""
    kinds = {True: "better", False: "worse"}
    lines = "".join(f'<li class="{kinds[each.passed]}">{escape(each.line)}</li>' for each in gates)
    return section("Gates", f"<ul>{lines}</ul>") if gates else ""


def _notes(results: Results) -> str:
    notes = "".join(f"<li>{escape(text)}</li>" for text in NOTES)
    made_with = "; ".join(f"{name} {version or 'unknown'}" for name, version in results.versions.items())
    return section(
        "How it was measured",
        f"<ul>{notes}</ul>",
        fold("Every measure: unit, frame, formula, source", definitions(results.success_rule), printed=True),
        note(f"Made with {made_with}."),
        note("In the same folder: results.json (these figures), episodes.parquet (a row an episode)."),
        note("python -m evaluate replay runs one of these episodes again, bit for bit on the same class of machine."),
    )


def warnings(results: Results) -> list[str]:
    """What a reader has to know first: policies with errors, and outcomes by an older rule of success."""
    lines = [
        f"{each.policy} failed in {each.failed} of {counted(each.episodes, 'episode')}; in the first it {each.first}"
        for each in results.policy_errors
    ]
    if results.success_rule != SUCCESS_RULE:
        lines.append(
            f"Success is by the older rule {results.success_rule}, under which these episodes ran: standing still can "
            f"succeed at slow commands. python -m evaluate report FOLDER --success {SUCCESS_RULE} prints today's"
        )
    if results.versions["energy_rule"] != ENERGY_RULE:
        lines.append(
            f"Energy and torques are by the older rule {ENERGY_1}, one reading a control step, and depend on the time "
            f"step; they do not compare with those by {ENERGY_RULE}"
        )
    return lines


def extent(results: Results) -> str:
    """`64 episodes of each policy on each of 27 scenarios, of document on flat alone`."""
    ran = {policy: [name for name, other in results.summaries if other == policy] for policy in results.policies}
    fewer = {policy: names for policy, names in ran.items() if len(names) < len(results.scenarios)}
    alone = [f"of {policy} on {listed(names)} alone" for policy, names in fewer.items() if results.complete]
    scenarios = counted(len(results.scenarios), "scenario")
    return ", ".join([f"{counted(results.episodes, 'episode')} of each policy on each of {scenarios}", *alone])
