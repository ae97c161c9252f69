"""Every measure: its figures on each scenario, and what it means."""

from html import escape

from evaluate.analysis.results import Results
from evaluate.measures.catalogue import BY_NAME, FIGURES, KEY, MEASURES, outcome
from evaluate.measures.outcomes import RULES
from evaluate.report.headings import FIRST
from evaluate.report.html import heading, note, table
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT


def figures_table(results: Results, scenario: str) -> str:
    """Every measure of the catalogue: a measure a row, a policy a column."""
    found = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [
        {FIRST: heading(escape(BY_NAME[name].title), escape(BY_NAME[name].unit))}
        | {policy: _figure(summary.figures[name]) for policy, summary in found.items()}
        for name in FIGURES
        if any(summary.figures[name] == summary.figures[name] for summary in found.values())
    ]
    rows += [
        {FIRST: f"duty factor, {leg}"}
        | {policy: _figure(summary.duty_factor[foot]) for policy, summary in found.items()}
        for foot, leg in enumerate(results.hardware.quadruped.leg_names)
    ]
    return table({FIRST: "measure", **{policy: policy_label(results, policy) for policy in found}}, rows)


def definitions(success_rule: str) -> str:
    """The table of measures, the outcome by that rule."""
    rows = [
        {
            "measure": f"{escape(m.title)}<small>{m.name}</small>",
            "unit": escape(m.unit) or ABSENT,
            "frame": escape(m.frame) or ABSENT,
            "formula": escape(m.formula),
            "source": escape(m.source) or "this project",
            "over": m.scope,
        }
        for m in (outcome(RULES[success_rule]), *MEASURES[1:])
    ]
    return note(KEY) + table({column: column for column in rows[0]}, rows, "text")


def _figure(value: float) -> str:
    """Four significant digits."""
    return f"{value:.4g}" if abs(value) < float("inf") else ABSENT
