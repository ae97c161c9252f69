"""What every disturbance does to every policy, in one table."""

from html import escape

from evaluate.analysis.results import Results
from evaluate.analysis.sensitivity import LEAD, effect_text
from evaluate.analysis.severity_levels import amount
from evaluate.report.html import note, section
from evaluate.report.sections.overview import by_axis


def sensitivity(results: Results) -> str:
    """An axis a row; empty for a run without the undisturbed scenario, or with nothing else."""
    cells = {(each.axis, each.policy): escape(effect_text(each)) for each in results.sensitivities}
    axes = {each.axis: amount(each.severity, each.unit) for each in results.sensitivities}
    return section("What each disturbance does", note(LEAD), by_axis(results, axes, cells)) if axes else ""
