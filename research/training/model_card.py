"""Functions that create the text of MODEL.md, the model card of a trained policy.

The model card describes the policy and its training, and has the results of its evaluation.
"""

from collections.abc import Mapping, Sequence

import numpy as np

import policies
from evaluate import hardware
from evaluate.analysis.results import Results
from evaluate.records.provenance import cpu_model
from evaluate.report.headings import EFFORT_TITLES, ROW_LABEL, format_effort
from policies.base import CONTROL_PERIOD, GaitedPolicy
from policies.network import ACTIVATION
from quad_env.cli.format import NO_BREAK, join_names, number
from quad_env.scenarios.registry import STEADY
from quad_env.sensing.height_scan import HeightScan
from research.pages import markdown
from research.training.card_tables import reference_name, results_table, scores_table, significant_scenarios
from research.training.trained_run import TrainedRun
from train.config import TrainConfig
from train.distillation.config import DistillationConfig

GAIT_SCENARIOS = ("steady", "steady+hardware")
"""Scenarios on which the model card reports the gait: a steady walk at 0.5 m/s, also with the hardware profile."""
GAIT_FIGURES = ("step_rate", "duty_factor", "flight", "trunk_height", "cost_of_transport")
"""Names of the gait and effort measures of the model card."""
START = "start"
"""Name of the student with which PPO has started, in the tables of the model card."""


def model_card(
    name: str,
    runs: list[TrainedRun],
    shipped: TrainedRun,
    results: Results,
    *,
    further: Sequence[Results] = (),
    times: Mapping[str, float] | None = None,
    has_films: bool = False,
) -> str:
    """Return the text of MODEL.md, the model card of a trained policy.

    Args:
        name: Name of the shipped policy.
        runs: All evaluated training runs.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation of all training runs and of the baseline.
        further: Results with other baselines, for the further policies that the shipped policy is compared with.
        times: Name of a policy -> processor time of an action for one robot, s; None if it is not measured.
        has_films: True to leave a place for the films that `python -m research gaits` writes into the card.

    Returns:
        Text of the file, Markdown.
    """
    kinds: dict[str, str] = {run.kind: run.kind for run in runs} | {shipped.kind: name}
    tables = "\n\n".join(
        results_table(display_name, [run for run in runs if run.kind == kind], shipped, results)
        for kind, display_name in kinds.items()
    )
    sections = [
        f"# {name}",
        describe_policy(shipped),
        training_section(shipped),
        f"## Results\n\n{_results_introduction(results)}\n\n{tables}",
        scores_table(kinds, runs, shipped, results),
        _verdict(shipped, results),
    ]
    for other in further:
        sections += [_comparison_section(name, [run for run in runs if run.kind == shipped.kind], shipped, other)]
    sections += [time_section(name, shipped, times or {}), gait_section(name, shipped, results, has_films=has_films)]
    return "\n\n".join(filter(None, sections)) + "\n"


def describe_policy(shipped: TrainedRun) -> str:
    """Describe in words the network of a trained policy: its size, its output, and its inputs."""
    config = shipped.config
    hidden = config.fit.hidden if isinstance(config, DistillationConfig) else config.ppo.actor
    text = f"A {' × '.join(map(str, hidden))} network ({ACTIVATION}) that {describe_correction(config)}."
    if shipped.teacher:
        origin = f"has learned the actions of `{shipped.teacher}` and runs alone"
        text += f" It {origin}." if not shipped.start else f" PPO has improved it from a student, which {origin}."
    inputs = describe_inputs(shipped) if shipped.bundle.is_dir() else ""
    return (
        f"{text}{inputs} `policy.json` says what it reads, on what base and with which settings it was trained; "
        "`policy.safetensors` holds its weights. Nothing in this folder is code."
    )


def describe_inputs(shipped: TrainedRun) -> str:
    """Describe in words the inputs of the network in a bundle, and its servo gains; each sentence follows a space."""
    policy = policies.load(shipped.bundle, shipped.config.hardware.robot_model, servo="own")
    inputs = policy.features.inputs
    parts = ["the observation"]
    if inputs.terms:
        names = join_names([name.replace("_", " ") for name in inputs.terms])
        rate = 1.0 / (policy.hold * policy.control_period)
        parts = [f"the last {inputs.history} values at {rate:g} Hz of {names}"]
    if policy.height_scan is not None:
        parts.append(_describe_scan(policy.height_scan))
    if isinstance(policy.base, GaitedPolicy):
        parts.append("phase and action of the base")
    if inputs.clock:
        faster = f", up to {inputs.clock_limit:g} Hz faster after a push" if inputs.clock_gain else ""
        parts.append(f"a clock of {inputs.clock:g} Hz{faster}")
    if inputs.position_error:
        parts.append(f"the position error since the last command, at most {inputs.position_error:g} m")
    if inputs.lags:
        parts.append(f"the observations of {', '.join(f'{lag:g}' for lag in inputs.lags)} s ago")
    if inputs.averages:
        parts.append(f"averages of the observation over {', '.join(f'{time:g}' for time in inputs.averages)} s")
    reads = f" The network reads {policy.network.sizes[0]} numbers: {join_names(parts)}."
    return f"{reads} The policy commands servos of {policy.robot.servo}."


def _describe_scan(scan: HeightScan) -> str:
    """Describe in words a height scan that a network reads: its grid, noise and delay."""
    rows, columns, _ = scan.grid.shape
    grid = f"{rows} × {columns} points {scan.spacing:g} m apart"
    return f"a height scan of the ground ({grid}, noise of {scan.noise:g} m, {scan.delay:g} s late)"


def _results_introduction(results: Results) -> str:
    """Return the paragraph above the results table: episodes, intervals and success rule."""
    return (
        f"{results.episodes} episodes of 10 s a scenario, the same for every policy (`--seed {results.seed}`); in "
        "brackets 95 % intervals and p-values, which are paired by episode and corrected by Holm's method over the "
        f"comparisons of a column. Success is by the rule `{results.versions['success_rule']}`; every step after a "
        "fall counts with the largest error. The intervals of a mean of seeds, and of its difference, contain the "
        "spread over training seeds and episodes."
    )


def _verdict(shipped: TrainedRun, results: Results) -> str:
    """Return the section of the model card on the scenarios on which the policy is better, worse or weak."""
    base = reference_name(shipped, results.baseline)
    return f"## Where it is better than `{base}`, and where it is weak\n\n{significant_scenarios(shipped, results)}"


def _comparison_section(name: str, runs: Sequence[TrainedRun], shipped: TrainedRun, results: Results) -> str:
    """Return the section of the model card that compares the policy with a further policy, its start.

    Args:
        name: Name of the shipped policy.
        runs: Training runs of the kind of the shipped policy.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation, with the further policy as baseline.

    Returns:
        The section, Markdown.
    """
    base = reference_name(shipped, results.baseline)
    parts = [
        f"## Compared with its start\n\n`{base}` is the policy with which the training of each seed began, by --start.",
        results_table(name, runs, shipped, results),
        scores_table({shipped.kind: name}, runs, shipped, results),
        significant_scenarios(shipped, results),
    ]
    return "\n\n".join(filter(None, parts))


def time_section(name: str, shipped: TrainedRun, times: Mapping[str, float]) -> str:
    """Return the section of the model card on the processor time of an action; empty if it is not measured.

    Args:
        name: Name of the shipped policy.
        shipped: Training run of the shipped policy.
        times: Name of a policy -> processor time of an action for one robot, s.

    Returns:
        The section, Markdown.
    """
    if shipped.label not in times:
        return ""
    figures = [f"`{name}` {_milliseconds(times[shipped.label])}"]
    figures += [
        f"`{reference_name(shipped, reference)}` {_milliseconds(times[reference])}"
        for reference in shipped.references
        if reference in times
    ]
    return (
        "## Time of an action\n\nFrom the observation to the joint targets of one robot on one core, median of a walk "
        f"on flat ground, processor time ({cpu_model()}): {', '.join(figures)}."
    )


def _milliseconds(seconds: float) -> str:
    """Format a time, s, in milliseconds with three decimals."""
    return f"{number(1e3 * seconds)}{NO_BREAK}ms"


def gait_section(name: str, shipped: TrainedRun, results: Results, *, has_films: bool = False) -> str:
    """Return the section of the model card on the gait at 0.5 m/s; empty if no steady walk was evaluated.

    Args:
        name: Name of the shipped policy.
        shipped: Training run of the shipped policy.
        results: Results of the evaluation.
        has_films: True to leave a place for the films that `python -m research gaits` writes into the card.

    Returns:
        The section, Markdown.
    """
    walks = [scenario for scenario in GAIT_SCENARIOS if scenario in results.scenarios]
    if not walks:
        return ""
    heads = {ROW_LABEL: "controller", "speed": "speed, m/s"}
    heads |= {figure: ", ".join(filter(None, EFFORT_TITLES[figure])) for figure in GAIT_FIGURES}
    labels = {shipped.label: name} | {label: reference_name(shipped, label) for label in shipped.references}
    rows = [
        {ROW_LABEL: f"`{display_name}`" + ("" if walk == STEADY.name else f" on `{walk}`")}
        | _gait_row(label, walk, results)
        for walk in walks
        for label, display_name in labels.items()
    ]
    text = f"## Gait\n\nAt 0.5 m/s on level ground, means over the episodes.\n\n{markdown.table(heads, rows)}"
    films = " ".join((name, *(f"{name}@{walk}" for walk in walks if walk != STEADY.name)))
    place = f"\n\n<!-- gaits {shipped.config.robot} {films} -->\n<!-- /gaits -->"
    return f"{text}{place}" if has_films else text


def _gait_row(policy: str, scenario: str, results: Results) -> dict[str, str]:
    """Return the cells of the gait table for a policy on a steady walk: name of the column -> text."""
    effort = results.summaries[scenario, policy].effort
    (cell,) = (each for each in results.cells if (each.policy, each.scenario.name) == (policy, scenario))
    speeds = cell.measures.mean_velocities[..., 0]
    speeds = speeds[np.isfinite(speeds)]
    speed = number(float(speeds.mean()) if speeds.size else float("nan"), 2)
    return {"speed": speed, **{name: format_effort(name, effort.get(name, float("nan"))) for name in GAIT_FIGURES}}


def training_section(run: TrainedRun) -> str:
    """Return the section of the model card on the training: command, settings, duration and Git revision."""
    config = run.config
    if isinstance(config, DistillationConfig):
        amount = f"{config.rounds * config.round_labels:,} labels of `{config.teacher}` from {config.envs} robots"
    else:
        amount = f"{config.steps:,} steps of {config.ppo.envs} robots"
    cpu_time = "" if run.cpu_minutes is None else f"{run.cpu_minutes:.1f} min of processor time in "
    return f"""## Training

    {run.command}

{amount} ({describe_mixture(config)}), {cpu_time}{run.minutes:.1f} min, \
source {run.git_revision}.{hardware.describe_hardware(config.hardware)} The shipped seed is {config.seed}, \
fixed beforehand, and of its run the weights of the best validation, on seeds and ground that neither training nor \
evaluation uses. {describe_origin(run)}"""


def describe_origin(run: TrainedRun) -> str:
    """Describe in words the Git revision that trained the policy, and its training command."""
    present_command = run.command
    original_command = run.command_then or present_command
    is_unchanged = original_command == present_command
    command_words = "has these settings too" if is_unchanged else f"is `{original_command}`"
    return (
        f"The command above has these settings in this version's options. The weights were trained at revision "
        f"{run.git_revision[:8]}, where the command {command_words}; later code may train other weights."
    )


def describe_correction(config: TrainConfig | DistillationConfig) -> str:
    """Describe in words how the policy corrects joint targets: base policy, rate, Hz, and limits, rad."""
    if isinstance(config, DistillationConfig):
        limits = f"{config.joint_authority:g} rad a joint, {config.hip_authority:g} rad at the hips"
        rate = 1.0 / (CONTROL_PERIOD * config.hold)
        return f"moves the joints from the home pose at {rate:g} Hz by at most {limits}"
    rate = 1.0 / (CONTROL_PERIOD * config.ppo.hold)
    authority = f"{config.joint_authority:g} rad a joint, {config.hip_authority:g} rad at the hips"
    amount = "by at most" if config.correction == "bounded" else "without limits, in units of"
    return f"corrects `{config.base}` at {rate:g} Hz {amount} {authority}"


def describe_mixture(config: TrainConfig | DistillationConfig) -> str:
    """Describe in words the training scenarios, each with the percentage of the robots that train on it."""
    total = sum(share for _, share in config.mixture)
    return ", ".join(f"{share / total:.0%} {name}" for name, share in config.mixture if share)
