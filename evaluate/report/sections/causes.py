"""Report section on causes of failure: a plot for each policy, without and with the hardware profile.

A plot has a bar for each disturbance axis, which is divided into the causes.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.causes.rules import CAUSES
from evaluate.report.html import grid, image, mark, note, section
from evaluate.report.plots import causes as plots
from evaluate.report.plots.drawing import figure_to_svg
from quad_env.scenarios.scenario import HARDWARE

LEAD = (
    "Failed episodes by the first deciding event, by the rules of docs/causes.md, in % of the episodes of an axis. "
    "python -m evaluate replay FOLDER EPISODE prints the story of one episode."
)
"""Explanation that the report shows above the plots of the causes of failure."""
TITLES = {False: "The policy is shown the true state", True: "Hardware profile"}
"""True (with the hardware profile) or False (without it) -> heading above the plots of causes of failure."""


def render_causes(results: Results) -> str:
    """Render the section on causes of failure as HTML; empty if no cause of failure is known in the run."""
    occurring = {cause for summary in results.summaries.values() for cause in summary.causes}
    if not occurring:
        return ""
    key = " &ensp;".join(_key_entry(cause) for cause in CAUSES if cause in occurring)
    return section("Why they fail", note(LEAD), f"<p>{key}</p>", *_cause_plots(results))


def _key_entry(cause: str) -> str:
    """Render the name of a `cause` of failure with its colour as HTML, for the legend above the plots."""
    return f'<span style="white-space:nowrap">{mark(plots.COLOURS[cause], "■")}{cause.replace("_", " ")}</span>'


def _cause_plots(results: Results) -> Iterator[str]:
    """Yield headings and plots as HTML: a plot for each policy that failed, in the order of the ranking.

    The plots below the first heading are for scenarios without the hardware profile, below the second heading for
    scenarios with it.
    """
    for on_hardware_profile, title in TITLES.items():
        axes = [axis for axis in severity_axes(results.cells) if axis.name.endswith(HARDWARE) == on_hardware_profile]
        order = dict.fromkeys((*(place.policy for place in results.ranking.places), *results.policies))
        shares = {policy: dict(_shares(results, policy, axes)) for policy in order}
        pictures = "".join(_cause_plot(policy, by_axis) for policy, by_axis in shares.items() if any(by_axis.values()))
        if pictures:
            yield f"<h3>{title}</h3>{grid([pictures])}"


def _cause_plot(policy: str, shares: Mapping[str, Mapping[str, float]]) -> str:
    """Render the plot of the causes of failure of one `policy` as HTML.

    `shares` is a dictionary: disturbance axis -> cause -> failed episodes, in % of the episodes on the axis.
    """
    svg = figure_to_svg(plots.draw_cause_bars(policy, shares))
    return image(svg, f"Causes of failures of {policy} on each axis, in per cent")


def _shares(results: Results, policy: str, axes: Iterable[SeverityAxis]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the name of each disturbance axis that the policy ran, and the causes of failure on this axis.

    The causes are a dictionary: cause -> episodes that failed from this cause, in % of the episodes of the policy on
    the axis.
    """
    for axis in axes:
        summaries = [
            summary for level in axis.levels if (summary := results.summaries.get((level.name, policy))) is not None
        ]
        if summaries:
            counts = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
            share = 100.0 / sum(summary.episodes for summary in summaries)
            yield axis.name.removesuffix(HARDWARE), {cause: share * counts[cause] for cause in CAUSES if counts[cause]}
