"""Tables of MODEL.md, the model card of a trained policy: results by scenario, scores, and lists of scenarios."""

from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np

from evaluate.analysis.comparison import FALL_RATE, METRICS, RATES, SIGNIFICANT, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.score import Score, select_scored_cells
from evaluate.analysis.seed_groups import SeedGroup
from evaluate.analysis.summary import Summary
from evaluate.statistics.intervals import Interval
from evaluate.statistics.training_seeds import mean_interval
from quad_env.cli.format import number, p_value, percent, points, points_with, share
from research.pages import markdown
from research.pages.evaluations import score_table
from research.training.trained_run import TrainedRun

DIFFERENCES: Interval = (-1.0, 1.0)
"""Smallest and largest possible difference of two success rates."""
START = "start"
"""Name of the policy with which PPO has started, in the tables of the model card."""
CARD_METRICS = (FALL_RATE, "velocity_error", "yaw_rate_error")
"""Names of the metrics for which the results table of the model card shows two values.

The first is the value of the baseline policy, the second is the value of the trained policy.
"""


def reference_name(shipped: TrainedRun, reference: str) -> str:
    """Return the name of a policy that the shipped one is compared with, as the model card shows it.

    Args:
        shipped: Training run of the shipped policy.
        reference: Name or path of the policy in the evaluation.

    Returns:
        The name in the card.
    """
    return START if shipped.start and reference == shipped.start else reference


def results_table(display_name: str, runs: Sequence[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """Create the results table of one kind of policy and the baseline, with one row per scenario.

    A kind of policy is `residual` (it corrects a base policy with a gait) or `end-to-end` (its base only holds a pose).

    Args:
        display_name: Name of the policy in the table.
        runs: Training runs of this kind of policy, one for each seed.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Markdown table.
    """
    first, *others = sorted(runs, key=lambda run: run is not shipped)
    base = reference_name(shipped, results.baseline)
    name = f"{display_name} {format_seed(first, shipped)}"
    other_seeds = ", ".join(str(run.config.seed) for run in others)
    heads = {"scenario": "scenario", "before": f"success, `{base}`", "after": f"success, {name}"}
    heads |= {"seeds": f"seeds {other_seeds}", "median": "median"} if others else {}
    heads[SUCCESS_RATE] = f"{name} minus `{base}`, points"
    if others:
        heads |= {"mean": f"mean of {len(runs)} seeds", "mean difference": "difference of this mean, points"}
    heads |= {metric: f"{markdown.IN_A_LINE[metric]}, `{base}` / {name}" for metric in CARD_METRICS}
    return markdown.table(heads, (_row(scenario, shipped, (first, *others), results) for scenario in results.scenarios))


def scores_table(
    display_names: Mapping[str, str], runs: Sequence[TrainedRun], shipped: TrainedRun, results: Results
) -> str:
    """Create the table of the scores of the baseline and of each training run, the highest score first.

    Args:
        display_names: Kind of policy (`residual` or `end-to-end`) -> name of the policy in the table.
        runs: Evaluated training runs.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Markdown table; an empty text if there are no scores.
    """
    labels = {run.label: f"{display_names[run.kind]} {format_seed(run, shipped)}" for run in runs}
    labels |= {name: f"`{reference_name(shipped, name)}`" for name in shipped.references}
    columns = []
    for scores, on_profile in ((results.scores, False), (results.hardware_scores, True)):
        # The score over a single disturbance axis is left out, because the results table has the same number.
        scored = [score for score in scores if len(score.axes) != 1 and score.policy in labels]
        if scored:
            groups = _group_scores(display_names, runs, shipped, results, hardware=on_profile)
            labels |= {score.policy: score.policy for score in groups}
            scored = sorted((*scored, *groups), key=lambda score: -score.score)
        columns.append(scored)
    if not any(columns):
        return ""
    return "\n".join(score_table(columns[0], results.baseline, labels, columns[1]))


def _group_scores(
    display_names: Mapping[str, str],
    runs: Sequence[TrainedRun],
    shipped: TrainedRun,
    results: Results,
    *,
    hardware: bool,
) -> list[Score]:
    """Compute the mean score of the training seeds of each kind of policy, and its difference from the baseline.

    Args:
        display_names: Kind of policy -> name of the policy in the table.
        runs: Evaluated training runs.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation.
        hardware: True for the score on the scenarios with the hardware profile, False for the other score.

    Returns:
        One score for each kind of policy with several training seeds that have a score.
    """
    scored = select_scored_cells(results.cells, hardware=hardware)
    scores = []
    for kind, display_name in display_names.items():
        seeds = [run for run in runs if run.kind == kind]
        group = find_group(kind, results)
        mean = None if group is None else group.hardware_score if hardware else group.score
        if mean is None:
            continue
        pairs = [(run.label, reference_of(run, shipped, results)) for run in seeds]
        values = np.array([scored.by_episode(mine) - scored.by_episode(theirs) for mine, theirs in pairs])
        label = f"mean of {len(seeds)} seeds of {display_name}"
        interval = mean_interval(values, DIFFERENCES)
        scores.append(Score(label, mean.score, mean.ci, {}, float(values.mean()), interval, float("nan")))
    return scores


def find_group(kind: str, results: Results) -> SeedGroup | None:
    """Return the results of the training seeds of a kind of policy as one entry; None if there are not several."""
    return next((group for group in results.groups if group.name == kind), None)


def reference_of(run: TrainedRun, shipped: TrainedRun, results: Results) -> str:
    """Return the policy that a run is compared with: its own start if the shipped run is compared with its start.

    Args:
        run: Training run.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation, which name the policy that the shipped one is compared with.

    Returns:
        Name of the policy in the evaluation.
    """
    if shipped.start and results.baseline == shipped.start and run.start:
        return run.start
    return results.baseline


def seed_difference(
    runs: Sequence[TrainedRun], shipped: TrainedRun, scenario: str, results: Results
) -> tuple[float, Interval]:
    """Compute the difference of success between training seeds and the baseline on one scenario, paired by episode.

    Args:
        runs: Training runs of one kind of policy, one for each seed.
        shipped: Training run of the shipped policy.
        scenario: Name of the scenario.
        results: Results of the evaluation.

    Returns:
        difference: Mean success of the seeds minus success of the policies that they are compared with, −1 … 1.
        interval: 95 % interval of the difference over training seeds and episodes, −1 … 1.
    """
    success = {cell.policy: cell.measures.succeeded for cell in results.cells if cell.scenario.name == scenario}
    values = np.array(
        [success[run.label].astype(np.float64) - success[reference_of(run, shipped, results)] for run in runs]
    )
    return float(values.mean()), mean_interval(values, DIFFERENCES)


def _row(scenario: str, shipped: TrainedRun, runs: Sequence[TrainedRun], results: Results) -> dict[str, str]:
    """Create one row of `results_table`: the results on one scenario.

    Args:
        scenario: Name of the scenario of the row.
        shipped: Training run of the shipped policy.
        runs: Training runs of one kind of policy. Only the first run is shown with all metrics; the row shows only the
            success of the further runs.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Name of the column -> text of the cell.
    """
    before = results.summaries[scenario, results.baseline]
    after, *other_seeds = (results.summaries[scenario, run.label] for run in runs)
    compared = {
        metric: _baseline_difference(results.baseline, scenario, runs[0], metric, results) for metric in METRICS
    }
    row = {
        "scenario": scenario,
        "before": share(before.success_rate, before.success_rate_ci),
        "after": share(after.success_rate, after.success_rate_ci),
        "seeds": ", ".join(percent(summary.success_rate) for summary in other_seeds),
        "median": percent(median(summary.success_rate for summary in (after, *other_seeds))),
        SUCCESS_RATE: format_success_difference(compared[SUCCESS_RATE]),
    }
    if other_seeds and (group := find_group(runs[0].kind, results)) is not None:
        rate = group.scenarios[scenario]
        row["mean"] = share(rate.success_rate, rate.success_rate_ci)
        row["mean difference"] = points_with(*seed_difference(runs, shipped, scenario, results)).with_interval
    for metric in CARD_METRICS:
        row[metric] = f"{_figure(before, metric)} / {_figure(after, metric)}, {format_difference(compared[metric])}"
    return row


def _figure(summary: Summary, metric: str) -> str:
    """Format a metric's value of one policy on one scenario; the fall rate is shown as number of falls."""
    return str(summary.falls) if metric == FALL_RATE else number(getattr(summary, metric))


def _baseline_difference(base: str, scenario: str, run: TrainedRun, metric: str, results: Results) -> Comparison:
    """Return the comparison of a trained policy with the baseline, by one metric on one scenario.

    Args:
        base: Name of the baseline policy.
        scenario: Name of the scenario.
        run: Training run of the policy.
        metric: Name of the metric.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        The comparison, policy minus baseline.
    """
    key = (scenario, run.label, base, metric)
    return next(
        comparison
        for comparison in results.comparisons
        if (comparison.scenario, comparison.a, comparison.b, comparison.metric) == key
    )


def significant_scenarios(shipped: TrainedRun, results: Results) -> str:
    """List the scenarios on which the shipped policy is better or worse than the baseline, or weak.

    "Better" and "worse" mean a significant difference from the baseline. "Weak" means a success rate below one half.

    Args:
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Lists of names of scenarios, Markdown.
    """
    base = reference_name(shipped, results.baseline)
    more_successes = _significant_names(shipped, results, SUCCESS_RATE, 1.0)
    fewer_successes = _significant_names(shipped, results, SUCCESS_RATE, -1.0)
    more_falls = _significant_names(shipped, results, FALL_RATE, 1.0)
    weak = [name for name in results.scenarios if results.summaries[name, shipped.label].success_rate < 0.5]
    return "\n".join(
        (
            f"- Succeeds more often than `{base}`, p of at most {SIGNIFICANT:g}: {more_successes}.",
            f"- Succeeds less often: {fewer_successes}. Falls more often: {more_falls}.",
            f"- Succeeds in less than half of the episodes: {', '.join(weak) or 'nowhere'}.",
        )
    )


def _significant_names(shipped: TrainedRun, results: Results, metric: str, sign: float) -> str:
    """List the scenarios on which the shipped policy differs significantly from the baseline.

    Args:
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.
        metric: Name of the compared metric.
        sign: 1 to list scenarios on which the shipped policy has the larger value of the metric, -1 to list scenarios
            on which the baseline has the larger value.

    Returns:
        Text with the names of the listed scenarios and their number.
    """
    names = []
    for scenario in results.scenarios:
        comparison = _baseline_difference(results.baseline, scenario, shipped, metric, results)
        if sign * comparison.difference > 0.0 and comparison.p_value_holm <= SIGNIFICANT:
            names.append(scenario)
    return f"{', '.join(names) or 'nowhere'} ({len(names)} of {len(results.scenarios)})"


def format_difference(comparison: Comparison) -> str:
    """Format the difference of two policies and its p-value, corrected by Holm for multiple comparisons."""
    digits = points if comparison.metric in RATES else number
    return f"{digits(comparison.difference)} ({p_value(comparison.p_value_holm)})"


def format_success_difference(comparison: Comparison) -> str:
    """Format the difference of success of two policies in points, with its paired interval and its p-value."""
    difference = points_with(comparison.difference, comparison.ci)
    return f"{difference.with_interval} ({p_value(comparison.p_value_holm)})"


def format_seed(run: TrainedRun, shipped: TrainedRun) -> str:
    """Format the training seed of `run`, with the word `shipped` if it is the run of the shipped policy."""
    return f"{run.config.seed}{' (shipped)' if run is shipped else ''}"
