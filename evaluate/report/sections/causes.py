"""Section on causes of failures: bars by axis for each policy, with and without the hardware profile."""

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
"""Note above the bars."""
TITLES = {False: "The policy is shown the true state", True: "Hardware profile"}
"""With the hardware profile or not -> heading."""


def render_causes(results: Results) -> str:
    """Render the section; empty if no cause is known."""
    occurring = {cause for summary in results.summaries.values() for cause in summary.causes}
    if not occurring:
        return ""
    key = " &ensp;".join(_key_entry(cause) for cause in CAUSES if cause in occurring)
    return section("Why they fail", note(LEAD), f"<p>{key}</p>", *_cause_plots(results))


def _key_entry(cause: str) -> str:
    """Render a cause with its colour."""
    return f'<span style="white-space:nowrap">{mark(plots.COLOURS[cause], "■")}{cause.replace("_", " ")}</span>'


def _cause_plots(results: Results) -> Iterator[str]:
    """Render a heading and a plot for each policy that failed, in the order of the ranking."""
    for on_hardware_profile, title in TITLES.items():
        axes = [axis for axis in severity_axes(results.cells) if axis.name.endswith(HARDWARE) == on_hardware_profile]
        order = dict.fromkeys((*(place.policy for place in results.ranking.places), *results.policies))
        shares = {policy: dict(_shares(results, policy, axes)) for policy in order}
        pictures = "".join(_cause_plot(policy, by_axis) for policy, by_axis in shares.items() if any(by_axis.values()))
        if pictures:
            yield f"<h3>{title}</h3>{grid([pictures])}"


def _cause_plot(policy: str, shares: Mapping[str, Mapping[str, float]]) -> str:
    """Render the plot of one policy, as `draw_cause_bars`."""
    svg = figure_to_svg(plots.draw_cause_bars(policy, shares))
    return image(svg, f"Causes of failures of {policy} on each axis, in per cent")


def _shares(results: Results, policy: str, axes: Iterable[SeverityAxis]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield each axis that the policy ran, and its causes with their share of the axis's episodes, %."""
    for axis in axes:
        summaries = [
            summary for level in axis.levels if (summary := results.summaries.get((level.name, policy))) is not None
        ]
        if summaries:
            counts = sum((Counter(summary.causes) for summary in summaries), Counter[str]())
            share = 100.0 / sum(summary.episodes for summary in summaries)
            yield axis.name.removesuffix(HARDWARE), {cause: share * counts[cause] for cause in CAUSES if counts[cause]}
