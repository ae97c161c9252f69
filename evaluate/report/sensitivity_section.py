"""What every disturbance does to every policy, in one table."""

from html import escape

from evaluate.format import ABSENT
from evaluate.ladders import amount
from evaluate.report.disturbances import anchor
from evaluate.report.figures import named
from evaluate.report.html import note, section, table
from evaluate.results import Results
from evaluate.sensitivity import LEAD, words


def sensitivity(results: Results) -> str:
    """An axis a row; empty for a run without the undisturbed scenario, or with nothing else."""
    found = {(each.axis, each.policy): each for each in results.sensitivities}
    hardest = {each.axis: each for each in results.sensitivities}
    rows = [
        [
            f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(amount(of.severity, of.unit))}</small>',
            *(escape(words(found[axis, p])) if (axis, p) in found else ABSENT for p in results.policies),
        ]
        for axis, of in hardest.items()
    ]
    heads = ["axis", *(named(results, policy) for policy in results.policies)]
    return section("What each disturbance does", note(LEAD), table(heads, rows, "text")) if rows else ""
