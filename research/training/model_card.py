"""Functions that create the text of MODEL.md, the model card of a trained policy.

The model card describes the policy and its training, and has the results of its evaluation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from evaluate import hardware
from evaluate.analysis.comparison import FALL_RATE, METRICS, RATES, SIGNIFICANT, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from policies.base import CONTROL_PERIOD
from policies.network import ACTIVATION
from quad_env.cli.format import number, p_value, percent, points, share
from research.pages import markdown
from research.pages.evaluations import score_table
from train.config import POSES, TrainConfig
from train.run_record import training_command

CARD_METRICS = (FALL_RATE, "velocity_error", "yaw_rate_error")
"""Names of the metrics for which the results table of the model card shows two values.

The first is the value of the baseline policy, the second is the value of the trained policy.
"""


@dataclass(frozen=True)
class TrainedRun:
    """Finished training run, with the facts about it that the model card states."""

    label: str
    """Path of the training run's folder; the evaluation uses this text as the name of the policy."""
    config: TrainConfig
    """All training settings of the run, for example base policy, scenarios and PPO parameters."""
    minutes: float
    """Duration of the training including validations, min."""
    git_revision: str
    """Git revision of the code that trained the policy."""
    bundle: Path
    """Folder with the policy of the best validation: the files policy.json and policy.safetensors."""
    command_then: str | None = None
    """Training command with the option names of the version `git_revision`, which trained the policy.

    None if the command has the same option names in the present version."""

    @property
    def baseline(self) -> str:
        """Name of the policy with which the trained policy is compared.

        It is the base policy, to which the trained policy adds corrections. It is `trot` if the base policy only stands
        or crouches.
        """
        return "trot" if self.config.base in POSES else self.config.base


def model_card(name: str, runs: list[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """Return the text of MODEL.md, the model card of a trained policy.

    Args:
        name: Name of the shipped policy.
        runs: All evaluated training runs.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Text of the file, Markdown.
    """
    config = shipped.config
    kinds: dict[str, str] = {run.config.policy: run.config.policy for run in runs} | {config.policy: name}
    tables = "\n\n".join(
        results_table(display_name, [run for run in runs if run.config.policy == kind], shipped, results)
        for kind, display_name in kinds.items()
    )
    return f"""# {name}

A {" × ".join(map(str, config.ppo.actor))} network ({ACTIVATION}) that {describe_correction(config)}. \
`policy.json` says what it reads, on what base and with which settings it was trained; `policy.safetensors` \
holds its weights. Nothing in this folder is code.

{training_section(shipped)}

## Results

{results.episodes} episodes of 10 s a scenario, the same for every policy (`--seed {results.seed}`); in brackets 95 % \
intervals and p-values, which are paired by episode and corrected by Holm's method over the comparisons of a column. \
Success is by the rule `{results.versions["success_rule"]}`; every step after a fall counts with the largest error.

{tables}

{scores_table(kinds, runs, shipped, results)}

## Where it is better than `{shipped.baseline}`, and where it is weak

{significant_scenarios(shipped, results)}
"""


def training_section(run: TrainedRun) -> str:
    """Return the section of the model card on the training: command, settings, duration and Git revision."""
    config = run.config
    return f"""## Training

    {training_command(config)}

{config.steps:,} steps of {config.ppo.envs} robots ({describe_mixture(config)}), {run.minutes:.1f} min, \
source {run.git_revision}.{hardware.describe_hardware(config.hardware)} The shipped seed is {config.seed}, \
fixed beforehand, and of its run the weights of the best validation, on seeds and ground that neither training nor \
evaluation uses. {describe_origin(run)}"""


def describe_origin(run: TrainedRun) -> str:
    """Describe in words the Git revision that trained the policy, and its training command."""
    present_command = training_command(run.config)
    original_command = run.command_then or present_command
    is_unchanged = original_command == present_command
    command_words = "has these settings too" if is_unchanged else f"is `{original_command}`"
    return (
        f"The command above has these settings in this version's options. The weights were trained at revision "
        f"{run.git_revision[:8]}, where the command {command_words}; later code may train other weights."
    )


def describe_correction(config: TrainConfig) -> str:
    """Describe in words how the policy corrects joint targets: base policy, rate, Hz, and limits, rad."""
    rate = 1.0 / (CONTROL_PERIOD * config.ppo.hold)
    authority = f"{config.joint_authority:g} rad a joint, {config.hip_authority:g} rad at the hips"
    amount = "by at most" if config.correction == "bounded" else "without limits, in units of"
    return f"corrects `{config.base}` at {rate:g} Hz {amount} {authority}"


def describe_mixture(config: TrainConfig) -> str:
    """Describe in words the training scenarios, each with the percentage of the robots that train on it."""
    total = sum(share for _, share in config.mixture)
    return ", ".join(f"{share / total:.0%} {name}" for name, share in config.mixture if share)


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
    base = shipped.baseline
    name = f"{display_name} {format_seed(first, shipped)}"
    other_seeds = ", ".join(str(run.config.seed) for run in others)
    heads = {"scenario": "scenario", "before": f"success, `{base}`", "after": f"success, {name}"}
    heads |= {"seeds": f"seeds {other_seeds}", "median": "median"} if others else {}
    heads[SUCCESS_RATE] = f"{name} minus `{base}`, points"
    heads |= {metric: f"{markdown.IN_A_LINE[metric]}, `{base}` / {name}" for metric in CARD_METRICS}
    return markdown.table(heads, (_row(scenario, base, (first, *others), results) for scenario in results.scenarios))


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
    labels = {run.label: f"{display_names[run.config.policy]} {format_seed(run, shipped)}" for run in runs}
    # The score over a single disturbance axis is left out, because the results table has the same number.
    scored = [score for score in results.scores if len(score.axes) != 1]
    return "\n".join(score_table(scored, shipped.baseline, labels)) if scored else ""


def _row(scenario: str, base: str, runs: Sequence[TrainedRun], results: Results) -> dict[str, str]:
    """Create one row of `results_table`: the results on one scenario.

    Args:
        scenario: Name of the scenario of the row.
        base: Name of the baseline policy.
        runs: Training runs of one kind of policy. Only the first run is shown with all metrics; the row shows only the
            success of the further runs.
        results: Results of the evaluation of all training runs and of the baseline.

    Returns:
        Name of the column -> text of the cell.
    """
    before = results.summaries[scenario, base]
    after, *other_seeds = (results.summaries[scenario, run.label] for run in runs)
    differences = {
        metric: format_difference(_baseline_difference(base, scenario, runs[0], metric, results)) for metric in METRICS
    }
    row = {
        "scenario": scenario,
        "before": share(before.success_rate, before.success_rate_ci),
        "after": share(after.success_rate, after.success_rate_ci),
        "seeds": ", ".join(percent(summary.success_rate) for summary in other_seeds),
        "median": percent(median(summary.success_rate for summary in (after, *other_seeds))),
        SUCCESS_RATE: differences[SUCCESS_RATE],
    }
    for metric in CARD_METRICS:
        row[metric] = f"{_figure(before, metric)} / {_figure(after, metric)}, {differences[metric]}"
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
    base = shipped.baseline
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
        comparison = _baseline_difference(shipped.baseline, scenario, shipped, metric, results)
        if sign * comparison.difference > 0.0 and comparison.p_value_holm <= SIGNIFICANT:
            names.append(scenario)
    return f"{', '.join(names) or 'nowhere'} ({len(names)} of {len(results.scenarios)})"


def format_difference(comparison: Comparison) -> str:
    """Format the difference of two policies and its p-value, corrected by Holm for multiple comparisons."""
    digits = points if comparison.metric in RATES else number
    return f"{digits(comparison.difference)} ({p_value(comparison.p_value_holm)})"


def format_seed(run: TrainedRun, shipped: TrainedRun) -> str:
    """Format the training seed of `run`, with the word `shipped` if it is the run of the shipped policy."""
    return f"{run.config.seed}{' (shipped)' if run is shipped else ''}"
