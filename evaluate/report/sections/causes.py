"""Why each policy fails on each axis: bars of causes, without the hardware profile and with it."""

from collections import Counter
from collections.abc import Iterable, Iterator

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.causes.rules import CAUSES
from evaluate.report.html import grid, image, mark, note, section
from evaluate.report.plots import causes as plots
from evaluate.report.plots.drawing import svg
from quad_env.scenarios.scenario import HARDWARE

LEAD = (
    "Failed episodes by the first event that decides, by the rules of docs/causes.md, in % of an axis's episodes. "
    "python -m evaluate replay FOLDER EPISODE prints the story of one."
)
TITLES = {False: "The policy is shown the true state", True: "Hardware profile"}


def causes(results: Results) -> str:
    """Empty where no cause is known."""
    seen = {cause for summary in results.summaries.values() for cause in summary.causes}
    if not seen:
        return ""
    whole = '<span style="white-space:nowrap">{}{}</span>'
    key = (whole.format(mark(plots.COLOURS[cause], "■"), cause.replace("_", " ")) for cause in CAUSES if cause in seen)
    return section("Why they fail", note(LEAD), f"<p>{' &ensp;'.join(key)}</p>", *_pictures(results))


def _pictures(results: Results) -> Iterator[str]:
    """Headed, a picture for each policy that failed, in the order of the ranking."""
    for real, title in TITLES.items():
        axes = [axis for axis in severity_axes(results.cells) if axis.name.endswith(HARDWARE) == real]
        order = dict.fromkeys((*(each.policy for each in results.ranking.places), *results.policies))
        shares = {policy: dict(_shares(results, policy, axes)) for policy in order}
        drawn = (
            image(svg(plots.bars(policy, found)), f"Causes of failures of {policy} on each axis, in per cent")
            for policy, found in shares.items()
            if any(found.values())
        )
        if pictures := "".join(drawn):
            yield f"<h3>{title}</h3>{grid([pictures])}"


def _shares(results: Results, policy: str, axes: Iterable[SeverityAxis]) -> Iterator[tuple[str, dict[str, float]]]:
    """Each axis that the policy ran on, and by cause the share of its episodes, in per cent."""
    for axis in axes:
        if ran := [summary for level in axis.levels if (summary := results.summaries.get((level.name, policy)))]:
            counts = sum((Counter(summary.causes) for summary in ran), Counter[str]())
            share = 100.0 / sum(summary.episodes for summary in ran)
            yield axis.name.removesuffix(HARDWARE), {name: share * counts[name] for name in CAUSES if counts[name]}
