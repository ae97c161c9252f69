"""MODEL.md of a trained policy: its description, its training, its results with those of a baseline and other seeds."""

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
"""Metrics whose cells have the figures of both the baseline and the policy."""


@dataclass(frozen=True)
class TrainedRun:
    """What the card says of a finished run."""

    label: str
    config: TrainConfig
    minutes: float
    """Training time, validation included."""
    git_revision: str
    bundle: Path
    """Folder of the weights of its best validation."""
    command_then: str | None = None
    """Command of the run at its git revision; None if it equals today's."""

    @property
    def baseline(self) -> str:
        """What it is compared with: its base, or `trot` where that does not walk without the correction."""
        return "trot" if self.config.base in POSES else self.config.base


def model_card(name: str, runs: list[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """The whole MODEL.md of a policy that ships by that name.

    `runs` are all runs that were evaluated; the other policies of `results` are baselines.
    """
    config = shipped.config
    kinds: dict[str, str] = {run.config.policy: run.config.policy for run in runs} | {config.policy: name}
    tables = "\n\n".join(
        results_table(display_names, [run for run in runs if run.config.policy == kind], shipped, results)
        for kind, display_names in kinds.items()
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
    """Return the section of the card on the run's training: its command, its settings and the revision of its code."""
    config = run.config
    return f"""## Training

    {training_command(config)}

{config.steps:,} steps of {config.ppo.envs} robots ({describe_mixture(config)}), {run.minutes:.1f} min, \
source {run.git_revision}.{hardware.describe_hardware(config.hardware)} The shipped seed is {config.seed}, \
fixed beforehand, and of its run the weights of the best validation, on seeds and ground that neither training nor \
evaluation uses. {describe_origin(run)}"""


def describe_origin(run: TrainedRun) -> str:
    """Return the revision at which a run was trained, and the command with its settings there, in words."""
    today = training_command(run.config)
    then = run.command_then or today
    there = "has these settings too" if then == today else f"is `{then}`"
    return (
        f"The command above has these settings in this version's options. The weights were trained at revision "
        f"{run.git_revision[:8]}, where the command {there}; later code may train other weights."
    )


def describe_correction(config: TrainConfig) -> str:
    """What the policy does to its base, in words."""
    rate = 1.0 / (CONTROL_PERIOD * config.ppo.hold)
    most = f"{config.joint_authority:g} rad a joint, {config.hip_authority:g} rad at the hips"
    return f"corrects `{config.base}` at {rate:g} Hz by at most {most}"


def describe_mixture(config: TrainConfig) -> str:
    """Scenarios and shares in words."""
    total = sum(share for _, share in config.mixture)
    return ", ".join(f"{share / total:.0%} {name}" for name, share in config.mixture if share)


def results_table(display_names: str, runs: Sequence[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """The seeds of one policy and the baseline of the shipped one, a row for each scenario, in Markdown."""
    first, *others = sorted(runs, key=lambda run: run is not shipped)
    base, name = shipped.baseline, f"{display_names} {format_seed(first, shipped)}"
    rest = ", ".join(str(run.config.seed) for run in others)
    heads = {"scenario": "scenario", "before": f"success, `{base}`", "after": f"success, {name}"}
    heads |= {"seeds": f"seeds {rest}", "median": "median"} if others else {}
    heads[SUCCESS_RATE] = f"{name} minus `{base}`, points"
    heads |= {metric: f"{markdown.IN_A_LINE[metric]}, `{base}` / {name}" for metric in CARD_METRICS}
    return markdown.table(heads, (_row(scenario, base, (first, *others), results) for scenario in results.scenarios))


def scores_table(
    display_names: Mapping[str, str], runs: Sequence[TrainedRun], shipped: TrainedRun, results: Results
) -> str:
    """Scores of the baseline and of each run, the highest first, in Markdown; `called`: what to call a policy
    of each kind."""
    labels = {run.label: f"{display_names[run.config.policy]} {format_seed(run, shipped)}" for run in runs}
    scored = [score for score in results.scores if len(score.axes) != 1]  # of one axis it is the success in the table
    return "\n".join(score_table(scored, shipped.baseline, labels)) if scored else ""


def _row(scenario: str, base: str, runs: Sequence[TrainedRun], results: Results) -> dict[str, str]:
    """Figures of the baseline and of the first run, and the successes of the other runs, by column."""
    before, *after = (results.summaries[scenario, policy] for policy in (base, *(run.label for run in runs)))
    shown = after[0]
    seeds = [percent(each.success_rate) for each in after[1:]]
    found = {
        metric: format_difference(_baseline_difference(base, scenario, runs[0], metric, results)) for metric in METRICS
    }
    return {
        "scenario": scenario,
        "before": share(before.success_rate, before.success_rate_ci),
        "after": share(shown.success_rate, shown.success_rate_ci),
        "seeds": ", ".join(seeds),
        "median": percent(median(each.success_rate for each in after)),
        SUCCESS_RATE: found[SUCCESS_RATE],
        **{metric: f"{_figure(before, metric)} / {_figure(shown, metric)}, {found[metric]}" for metric in CARD_METRICS},
    }


def _figure(summary: Summary, metric: str) -> str:
    return str(summary.falls) if metric == FALL_RATE else number(getattr(summary, metric))


def _baseline_difference(base: str, scenario: str, run: TrainedRun, metric: str, results: Results) -> Comparison:
    """The run's difference from the baseline."""
    return next(
        each
        for each in results.comparisons
        if (each.scenario, each.a, each.b, each.metric) == (scenario, run.label, base, metric)
    )


def significant_scenarios(shipped: TrainedRun, results: Results) -> str:
    """Scenarios where the shipped policy is better or worse than its baseline, in Markdown."""
    base = shipped.baseline
    found = {
        (metric, scenario): _baseline_difference(base, scenario, shipped, metric, results)
        for metric in (SUCCESS_RATE, FALL_RATE)
        for scenario in results.scenarios
    }

    def where(metric: str, sign: float) -> str:
        names = [
            scenario
            for (of, scenario), each in found.items()
            if of == metric and sign * each.difference > 0.0 and each.p_value_holm <= SIGNIFICANT
        ]
        return f"{', '.join(names) or 'nowhere'} ({len(names)} of {len(results.scenarios)})"

    weak = [name for name in results.scenarios if results.summaries[name, shipped.label].success_rate < 0.5]
    return "\n".join(
        (
            f"- Succeeds more often than `{base}`, p of at most {SIGNIFICANT:g}: {where(SUCCESS_RATE, 1.0)}.",
            f"- Succeeds less often: {where(SUCCESS_RATE, -1.0)}. Falls more often: {where(FALL_RATE, 1.0)}.",
            f"- Succeeds in less than half of the episodes: {', '.join(weak) or 'nowhere'}.",
        )
    )


def format_difference(comparison: Comparison) -> str:
    """A difference and its p-value, corrected for the number of comparisons."""
    digits = points if comparison.metric in RATES else number
    return f"{digits(comparison.difference)} ({p_value(comparison.p_value_holm)})"


def format_seed(run: TrainedRun, shipped: TrainedRun) -> str:
    """A run's seed, marked where it is the one that ships."""
    return f"{run.config.seed}{' (shipped)' if run is shipped else ''}"
