"""MODEL.md of a trained policy: what it is, how it was trained, what it is worth beside its base and other seeds."""

from dataclasses import dataclass

from evaluate.analysis.comparison import METRICS, RATES, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from evaluate.rollouts import hardware
from evaluate.terminal.format import interval, number, p_value, percent, percent_interval, points
from policies.base import CONTROL_PERIOD
from train.config import TrainConfig
from train.run_record import command

HEADER = (
    "| scenario | policy | seed | success | falls | velocity error m/s | yaw-rate error rad/s "
    "| mean velocity error m/s |",
    "|---|---|---|---|---|---|---|---|",
)


@dataclass(frozen=True)
class TrainedRun:
    """A finished run as the card speaks of it."""

    label: str
    config: TrainConfig
    minutes: float
    """Training time, validation included."""
    git_revision: str


def model_card(runs: list[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """The whole MODEL.md; `runs` are all that were judged, and policies of `results` that are no run are baselines."""
    config = shipped.config
    return f"""# {config.policy}

A {" × ".join(map(str, config.ppo.actor))} network ({config.ppo.activation}) that {does(config)}. \
`policy.json` says what it reads, on what base and with which settings it was trained; `policy.safetensors` \
holds its weights. Nothing in this folder is code.

## Training

    {command(config)}

{config.steps:,} steps of {config.ppo.envs} robots ({mixture(config)}), {shipped.minutes:.1f} min, \
source {shipped.git_revision}.{hardware.words(config.hardware)} The shipped seed is {config.seed}, \
fixed beforehand, and of its run the weights of the best validation, on seeds and ground that neither training nor \
evaluation uses.

## Results

{results.episodes} episodes of 10 s a scenario, the same for every policy (`--seed {results.seed}`); in brackets 95 % \
intervals; errors bill every step after a fall their cap. Only the rows of one block share their episodes.

{table(runs, shipped, results)}

{against_base(runs, shipped, results)}
"""


def does(config: TrainConfig) -> str:
    """What the policy does to its base, in words."""
    rate = 1.0 / (CONTROL_PERIOD * config.ppo.hold)
    most = f"{config.joint_authority:g} rad a joint, {config.hip_authority:g} rad at the hips"
    if config.space == "feet":
        most = f"{config.foot_authority:g} m a foot, along each axis"
    words = f"corrects `{config.base}` at {rate:g} Hz by at most {most}"
    gait = config.gait_authority
    shifts = {
        "the command that it is shown by at most {:g} m/s and rad/s": config.command_authority,
        "its frequency by at most {:g} Hz": gait.frequency,
        "its step height by at most {:g} m": gait.step_height,
        "its body height by at most {:g} m": gait.body_height,
    }
    shifted = [each.format(limit) for each, limit in shifts.items() if limit]
    return words + (f"; it shifts {', '.join(shifted)}" if shifted else "")


def mixture(config: TrainConfig) -> str:
    """Scenarios and shares in words."""
    total = sum(share for _, share in config.mixture)
    return ", ".join(f"{share / total:.0%} {name}" for name, share in config.mixture if share)


def table(runs: list[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """A block for each scenario, a row for each policy, in Markdown."""
    lines = [*HEADER]
    seeds = {run.label: seed(run, shipped) for run in runs}
    names = {run.label: run.config.policy for run in runs}
    for (scenario, policy), summary in results.summaries.items():
        cells = (scenario, names.get(policy, policy), seeds.get(policy, "–"), *figures(summary))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def figures(summary: Summary) -> tuple[str, ...]:
    """Successes, falls and errors of one cell, each with its interval."""
    return (
        f"{summary.successes}, {percent(summary.success_rate)} ({percent_interval(summary.success_rate_ci)})",
        f"{summary.falls}, {percent(summary.fall_rate)} ({percent_interval(summary.fall_rate_ci)})",
        f"{number(summary.velocity_error)} ({interval(summary.velocity_error_ci)})",
        f"{number(summary.yaw_rate_error)} ({interval(summary.yaw_rate_error_ci)})",
        f"{number(summary.mean_velocity_error)} ({interval(summary.mean_velocity_error_ci)})",
    )


def against_base(runs: list[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """Each run's paired differences from the shipped policy's base, in Markdown, a row for each run and scenario."""
    base = shipped.config.base
    lines = [
        f"Minus `{base}`, paired by episode; success and falls in percentage points; p in brackets, "
        f"corrected by Holm's method over the {len(runs) * len(results.scenarios)} comparisons of a column:",
        "",
        *HEADER,
    ]
    found = {(each.scenario, each.a, each.metric): each for each in results.comparisons if each.b == base}
    for scenario in results.scenarios:
        for run in runs:
            cells = [difference(found[scenario, run.label, metric]) for metric in METRICS]
            lines.append(f"| {scenario} | {run.config.policy} | {seed(run, shipped)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def difference(comparison: Comparison) -> str:
    """A difference and its p-value, corrected for the number of comparisons."""
    digits = points if comparison.metric in RATES else number
    return f"{digits(comparison.difference)} ({p_value(comparison.p_value_holm)})"


def seed(run: TrainedRun, shipped: TrainedRun) -> str:
    """A run's seed, marked where it is the one that ships."""
    return f"{run.config.seed}{' (shipped)' if run is shipped else ''}"
