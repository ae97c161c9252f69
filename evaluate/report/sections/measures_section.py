"""Every measure: its figures on each scenario, and what it means."""

from html import escape

from evaluate.analysis.results import Results
from evaluate.measures.catalogue import BY_NAME, FIGURES, KEY, MEASURES, outcome
from evaluate.measures.outcomes import RULES
from evaluate.report.html import heading, note, table
from evaluate.report.sections.figures import policy_label
from evaluate.terminal.format import ABSENT


def figures_table(results: Results, scenario: str) -> str:
    """Every measure of the catalogue: a measure a row, a policy a column."""
    found = {policy: summary for (name, policy), summary in results.summaries.items() if name == scenario}
    rows = [
        [
            heading(escape(BY_NAME[name].title), escape(BY_NAME[name].unit)),
            *(_figure(summary.figures[name]) for summary in found.values()),
        ]
        for name in FIGURES
        if any(summary.figures[name] == summary.figures[name] for summary in found.values())
    ]
    rows += [
        [f"duty factor, {leg}", *(_figure(summary.duty_factor[foot]) for summary in found.values())]
        for foot, leg in enumerate(results.hardware.quadruped.leg_names)
    ]
    return table(["measure", *(policy_label(results, policy) for policy in found)], rows)


def definitions(success_rule: str) -> str:
    """The table of measures, the outcome by that rule."""
    rows = (
        (
            f"{escape(m.title)}<small>{m.name}</small>",
            escape(m.unit) or ABSENT,
            escape(m.frame) or ABSENT,
            escape(m.formula),
            escape(m.source) or "this project",
            m.scope,
        )
        for m in (outcome(RULES[success_rule]), *MEASURES[1:])
    )
    heads = ("measure", "unit", "frame", "formula", "source", "over")
    return note(KEY) + table(heads, rows, "text")


def _figure(value: float) -> str:
    """Four significant digits."""
    return f"{value:.4g}" if abs(value) < float("inf") else ABSENT
