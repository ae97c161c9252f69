"""Plan of an evaluation: options, policies and scenarios, all checked before the simulation starts."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import policies
from evaluate import hardware
from evaluate.cells import LabelledPolicy, load_labelled_policy
from evaluate.commands.groups import expand_patterns, split_groups
from evaluate.commands.interim_analysis import check_ranked
from evaluate.commands.options import (
    DEFAULT_BATTERY,
    DEFAULT_POLICIES,
    PROGRAM,
    EvaluateOptions,
    describe_changes,
    options_from_json,
)
from evaluate.hardware import HardwareConfig
from evaluate.records import manifest as manifests
from evaluate.records.manifest import CHUNKS, FILES, Manifest
from evaluate.records.shares import select_share
from evaluate.rollouts import battery, rollout
from evaluate.rollouts.cost import episode_costs
from evaluate.rollouts.time_limit import FIRST_ROUND
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.part import parse_part
from quad_env.cli.ray_option import parse_ray
from quad_env.files.writing import exclusive_lock, make_writable_folder
from quad_env.physics.simulators import MUJOCO
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

LIMITS: dict[str, tuple[float, float]] = {
    "episodes": (1, 1_000_000),
    "minutes": (0.1, 10_080),
    "seed": (0, 2**63 - 1),
    "threads": (1, 256),
    "at_once": (1, 65_536),
}
"""Name of an option -> smallest and largest valid value."""


@dataclass(frozen=True)
class Plan:
    """Plan of a run: checked options, loaded policies and scenarios, and the manifest (inputs of the run).

    A check has shown that every policy and scenario exists, and that the results folder can be written.
    """

    policies: tuple[LabelledPolicy, ...]
    scenarios: tuple[Scenario, ...]
    manifest: Manifest
    options: EvaluateOptions
    extends: bool = False
    """True if the run extends the finished run in the results folder by policies or episodes."""


def load_run_options(folder: Path, option: str = "--resume") -> EvaluateOptions:
    """Load the options of a run, in order to resume or extend it.

    Args:
        folder: Results folder of the run.
        option: Option that continues the run, for error messages.

    Returns:
        Options with which the run was started.

    Raises:
        UsageError: The folder contains no run, or a run that cannot be read.
    """
    if folder.is_dir():
        _check_unused(folder)
    if not (folder / manifests.NAME).is_file():
        raise UsageError(f"{option}: {folder} holds no run that was begun; leave {option} out to begin one")
    _, options = _read_run_options(folder, option)
    return options


def check(options: EvaluateOptions) -> Plan:
    """Load all policies and scenarios that the `options` name, and check all options.

    Args:
        options: Options of the command line.

    Returns:
        The plan of the run.

    Raises:
        UsageError: An option is not valid, or the folder cannot be written.
    """
    check_numbers(options, LIMITS)
    _check_battery(options)
    if options.ray is not None:
        parse_ray(options.ray)
    options = replace(
        options,
        episodes=options.max_episodes,
        minutes=options.time_limit or None,
        policies=expand_patterns(options.policies),
    )
    names, groups = split_groups(options.policies)
    try:
        hardware.check_hardware(options.hardware_config)
    except ValueError as error:
        raise UsageError(str(error)) from error
    try:
        scenarios = select_scenarios(options)
    except ValueError as error:
        raise UsageError(f"--scenarios: {error}") from error
    compared = select_policies(names, scenarios, options.hardware_config, options.trust)
    labels = [policy.label for policy in compared]
    if options.part is not None:
        _check_part(options)
    if options.until:
        check_ranked(compared, scenarios)
    check_baseline(options.baseline, labels)
    check_folder(options.out)
    manifest = _make_manifest(options, compared, scenarios, groups)
    if options.resume:
        manifest = _resume_manifest(manifest, options)
    return Plan(compared, scenarios, manifest, options)


def _make_manifest(
    options: EvaluateOptions,
    compared: Sequence[LabelledPolicy],
    scenarios: Sequence[Scenario],
    groups: Mapping[str, Sequence[str]],
) -> Manifest:
    """Make the manifest (all inputs) of a new run, or of the part of a run that --part names.

    Args:
        options: Checked options of the command line.
        compared: Policies of the run.
        scenarios: Scenarios of the run.
        groups: Name of a group of training seeds -> labels of its policies.

    Returns:
        The manifest.
    """
    manifest = manifests.manifest(
        compared,
        scenarios,
        options.run_options(),
        seed=options.seed,
        episodes=options.max_episodes,
        steps=rollout.STEPS,
        threads=options.threads,
        hardware=options.hardware_config,
    ).with_groups(groups)
    if options.time_limit:
        manifest = manifest.with_time_limit(options.time_limit, FIRST_ROUND)
    elif options.until:
        manifest = manifest.until_settled()
    if options.part is not None:
        costs = episode_costs(compared, scenarios)
        manifest = replace(manifest, share=select_share(parse_part(options.part), costs, options.max_episodes))
    return manifest


def select_scenarios(options: EvaluateOptions) -> tuple[Scenario, ...]:
    """Return the scenarios that the command-line options select.

    Scenarios of a battery (named list of scenarios) are left out if the chosen hardware or simulator does not support
    them.

    Args:
        options: Options of the command line.

    Returns:
        Scenarios in the order of the names in the options.

    Raises:
        UsageError: The options select both the hardware profile and other hardware, or a named scenario cannot be
            simulated. ValueError is raised if a scenario is unknown.
    """
    robot = options.hardware_config.robot_model
    scenarios = battery.resolve(options.battery, robot)
    if options.hardware:
        scenarios = battery.with_profile(scenarios)
    if options.simulator != MUJOCO:
        return _supported(options, scenarios)
    if not options.hardware_config.is_customized:
        return scenarios
    named = tuple(name for name in options.battery if name not in battery.BATTERIES)
    named_scenarios = battery.resolve(named, robot) if named else ()
    on_profile = [scenario.name for scenario in named_scenarios if scenario.hardware]
    if options.hardware or on_profile:
        option = "--hardware" if options.hardware else f"--scenarios {' '.join(on_profile)}"
        raise UsageError(f"{option}: the profile has its own --actuator, --sensors and --estimator: leave these out")
    return tuple(scenario for scenario in scenarios if not scenario.hardware)


def _supported(options: EvaluateOptions, scenarios: Sequence[Scenario]) -> tuple[Scenario, ...]:
    """Return the scenarios that the simulator supports; print the names of the other scenarios on stderr.

    Args:
        options: Options of the command line, with the name of the simulator.
        scenarios: Scenarios that the options name.

    Returns:
        Supported scenarios, in the same order.

    Raises:
        UsageError: The simulator supports none of the scenarios, or it does not support a scenario that the options
            name individually.
    """
    errors = {}
    for scenario in scenarios:
        try:
            hardware.check_hardware(options.hardware_config, scenario)
        except ValueError as error:
            errors[scenario.name] = error
    supported = tuple(scenario for scenario in scenarios if scenario.name not in errors)
    names = ", ".join(errors)
    if errors and (not supported or not set(options.battery) <= set(battery.BATTERIES)):
        raise UsageError(f"--scenarios {names}: {next(iter(errors.values()))}")
    if errors:
        print(f"left out, since {options.simulator} cannot simulate them: {names}", file=sys.stderr)
    return supported


def select_policies(
    names: tuple[str, ...], scenarios: Sequence[Scenario], hardware: HardwareConfig, trust: bool = False
) -> tuple[LabelledPolicy, ...]:
    """Load the named policies; the result contains the scenarios that each policy is restricted to.

    Args:
        names: Names or paths of policies; `NAME@SCENARIO` restricts a policy to a scenario.
        scenarios: Scenarios of the run.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.
        trust: True to load policies from files that can contain hidden code.

    Returns:
        Policies in the order of the names.

    Raises:
        UsageError: No policy is named, a policy is named twice or cannot be loaded, or a scenario after an `@` is not
            among `scenarios`.
    """
    if not names:
        valid = ", ".join(policies.names(hardware.robot_model))
        raise UsageError(f"--policies: none given; name at least one of {valid}, or a folder")
    if unlimited := [name for name in names if name.endswith("@")]:
        raise UsageError(f"--policies: name scenarios after the @ of {', '.join(unlimited)}, as in document@flat")
    selected = [_split_name(name) for name in names]
    if names == DEFAULT_POLICIES:
        run = {scenario.name for scenario in scenarios}
        selected = [(label, only_on) for label, only_on in selected if not only_on or run.intersection(only_on)]
        if hardware.robot != HardwareConfig.robot:
            selected = _without_untrained(selected, hardware.robot_model)
    _check_distinct([label for label, _ in selected])
    _check_scenarios(selected, [scenario.name for scenario in scenarios])
    try:
        return tuple(load_labelled_policy(label, hardware, scenarios, trust, only_on) for label, only_on in selected)
    except policies.PolicyError as error:
        raise UsageError(f"--policies: {error}") from error


def _check_part(options: EvaluateOptions) -> None:
    """Raise UsageError if --part is not valid, or does not fit another option."""
    parse_part(options.part or "")
    if options.until:
        raise UsageError("--part and --until settled: each part needs a fixed number of episodes; valid: --episodes")
    if options.minutes is not None:
        raise UsageError("--part and --minutes: each part needs a fixed number of episodes; valid: --episodes")


def _check_battery(options: EvaluateOptions) -> None:
    """Raise UsageError if more than one of --quick, --full and --scenarios selects the scenarios."""
    given = {"--quick": options.quick, "--full": options.full, "--scenarios": options.scenarios != DEFAULT_BATTERY}
    if len(names := [name for name, is_given in given.items() if is_given]) > 1:
        raise UsageError(f"{' and '.join(names)} both name the scenarios: give one of them")


def _without_untrained(selected: list[tuple[str, tuple[str, ...]]], robot: Robot) -> list[tuple[str, tuple[str, ...]]]:
    """Remove learned policies that are not trained for the `robot`, and print their names on stderr.

    Args:
        selected: For each policy its label, and the names of the scenarios that it is restricted to.
        robot: Robot of the run.

    Returns:
        The elements of `selected` that have not been removed.
    """
    untrained = [label for label, _ in selected if policies.is_missing(label, robot)]
    if untrained:
        names = ", ".join(untrained)
        print(f"left out, since {robot.name} has no such trained policy: {names}", file=sys.stderr)
    return [(label, only_on) for label, only_on in selected if label not in untrained]


def _split_name(name: str) -> tuple[str, tuple[str, ...]]:
    """Split a policy name such as `trot@flat` at the `@`: label, and scenarios that it is restricted to.

    If `name` is the name of an existing folder, it is not split.
    """
    label, scenarios = name, ""
    if not Path(name).is_dir() and not policies.is_reference(name):
        label, _, scenarios = name.partition("@")
    only_on = tuple(filter(None, scenarios.split(",")))
    if _is_name(label):
        return label, only_on
    return label.rstrip("/\\") or label, only_on


def _is_name(label: str) -> bool:
    """Return True if `label` is the name of a policy, also of a trained policy that only some robots have."""
    return label in policies.names() or label in policies.TRAINED


def _check_distinct(labels: list[str]) -> None:
    """Raise UsageError if two of the `labels` refer to the same policy."""
    sources = [label if _is_name(label) else str(Path(label).resolve()) for label in labels]
    if repeated := sorted({label for label, source in zip(labels, sources, strict=True) if sources.count(source) > 1}):
        raise UsageError(f"--policies: {', '.join(repeated)} given more than once; name each policy once")


def _check_scenarios(selected: list[tuple[str, tuple[str, ...]]], scenarios: list[str]) -> None:
    """Check that each scenario to which a policy is restricted (`NAME@SCENARIO`) is in the run.

    Args:
        selected: For each policy its label, and the names of the scenarios that it is restricted to.
        scenarios: Names of the scenarios of the run.

    Raises:
        UsageError: A policy names a scenario that is not in `scenarios`.
    """
    for label, only_on in selected:
        if unknown := [name for name in only_on if name not in scenarios]:
            valid = ", ".join(scenarios)
            raise UsageError(f"--policies: {label}@{','.join(unknown)} is not among the scenarios of this run: {valid}")


def check_baseline(baseline: str | None, labels: Sequence[str]) -> None:
    """Raise UsageError if `baseline` names a policy that is not among the `labels` of the policies."""
    if baseline is not None and baseline not in labels:
        raise UsageError(f"--baseline: {baseline} is not among the policies {', '.join(labels)}")


def check_folder(out: Path) -> None:
    """Make the results folder `out`; raise UsageError if the folder or a file in it cannot be written."""
    try:
        make_writable_folder(out)
    except OSError as error:
        raise UsageError(f"cannot write to the folder {out} ({error.strerror}); name another one with --out") from error
    _check_unused(out)
    if taken := [str(out / name) for name in FILES if (out / name).is_dir()]:
        raise UsageError(f"{', '.join(taken)} is a folder, not a file; name another folder with --out")
    if (out / CHUNKS).exists() and not (out / CHUNKS).is_dir():
        raise UsageError(f"{out / CHUNKS} is a file, not a folder; name another folder with --out")


def _check_unused(out: Path) -> None:
    """Raise FolderInUseError if another run is writing to the results folder `out`."""
    with exclusive_lock(out):
        pass


def _resume_manifest(now: Manifest, options: EvaluateOptions) -> Manifest:
    """Return the stored manifest (inputs) of the run to resume, after a check that no input has changed.

    Args:
        now: Manifest of a new run with the options of the command line.
        options: Options of the command line.

    Returns:
        The manifest in the results folder.

    Raises:
        UsageError: An input has changed, so that the results would differ from the results of an uninterrupted run.
    """
    then, run_options = _read_run_options(options.out)
    if changes := describe_changes(run_options, options):
        message = f"--resume carries a run on as it was begun, but {'; '.join(changes)}"
        raise UsageError(f"{message}{_resume_remedy(run_options, options)}")
    if changes := manifests.differences(then, now):
        raise UsageError(f"--resume carries a run on as it was begun, but {'; '.join(changes)}")
    if now.fingerprint != then.fingerprint:
        raise UsageError(f"{options.out / manifests.NAME} has been changed by hand; leave --resume out to begin again")
    return then


def _resume_remedy(then: EvaluateOptions, now: EvaluateOptions) -> str:
    """Return advice for the user if the new options add policies, episodes or scenarios to a run.

    Args:
        then: Options of the run to resume.
        now: Options of the command line.

    Returns:
        Advice to append to the error message; empty in other cases.
    """
    folder = shlex.quote(str(now.out))
    if added := [name for name in now.policies if name not in then.policies]:
        return f". Once it is finished, it is extended by `{PROGRAM} --add {shlex.join(added)} --out {folder}`"
    if now.max_episodes > then.max_episodes:
        return f". Once it is finished, it is extended by `{PROGRAM} --episodes {now.max_episodes} --out {folder}`"
    if set(now.scenarios) > set(then.scenarios):
        return ". A run is not extended by scenarios: leave --resume out and name another --out"
    return ""


def _read_run_options(folder: Path, option: str = "--resume") -> tuple[Manifest, EvaluateOptions]:
    """Read the manifest and the options of the run in a results folder; raise UsageError, with `option`, on failure."""
    try:
        manifest = manifests.read(folder)
        return manifest, replace(EvaluateOptions(out=folder), **options_from_json(manifest.options))
    except (OSError, UsageError, ValueError) as error:
        raise UsageError(f"{option}: {error}; leave {option} out to begin again") from error
