"""What a command line asks for, checked: everything that can be wrong is found before anything is simulated."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import policies
from evaluate import hardware
from evaluate.cells import LabelledPolicy, load_labelled_policy
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
from evaluate.rollouts import battery, rollout
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.writing import exclusive_lock, make_writable_folder
from quad_env.physics.simulators import MUJOCO
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

LIMITS = {"episodes": (1, 1_000_000), "seed": (0, 2**63 - 1), "threads": (1, 256), "at_once": (1, 65_536)}
"""Smallest and largest value of each number of the options."""


@dataclass(frozen=True)
class Plan:
    """Options that have been checked: everything exists and can be written."""

    policies: tuple[LabelledPolicy, ...]
    scenarios: tuple[Scenario, ...]
    manifest: Manifest
    options: EvaluateOptions


def load_run_options(folder: Path) -> EvaluateOptions:
    """The options of the run in a folder. Raises UsageError where there is none to carry on, or one is going on."""
    if folder.is_dir():
        _check_unused(folder)
    if not (folder / manifests.NAME).is_file():
        raise UsageError(f"--resume: {folder} holds no run that was begun; leave --resume out to begin one")
    return _begun(folder)[1]


def check(options: EvaluateOptions) -> Plan:
    """The plan of these options. Raises UsageError."""
    options = replace(options, episodes=options.max_episodes)
    check_numbers(options, LIMITS)
    if options.quick and options.scenarios != DEFAULT_BATTERY:
        raise UsageError("--quick and --scenarios both name the scenarios: give one of them")
    try:
        hardware.check_hardware(options.hardware_config)
    except ValueError as error:
        raise UsageError(str(error)) from error
    try:
        scenarios = scenarios_asked_for(options)
    except ValueError as error:
        raise UsageError(f"--scenarios: {error}") from error
    compared = policies_asked_for(options.policies, scenarios, options.hardware_config, options.trust)
    labels = [policy.label for policy in compared]
    if options.until:
        check_ranked(compared, scenarios)
    check_baseline(options.baseline, labels)
    _check_folder(options.out)
    manifest = manifests.manifest(
        compared,
        scenarios,
        options.run_options(),
        seed=options.seed,
        episodes=options.max_episodes,
        steps=rollout.STEPS,
        threads=options.threads,
        hardware=options.hardware_config,
    )
    if options.until:
        manifest = manifest.until_settled()
    if options.resume:
        manifest = _resume_manifest(manifest, options)
    return Plan(compared, scenarios, manifest, options)


def scenarios_asked_for(options: EvaluateOptions) -> tuple[Scenario, ...]:
    """The scenarios; of a battery only those without the hardware profile where the hardware is chosen by itself.
    Raises ValueError, and UsageError where both are asked for."""
    robot = options.hardware_config.robot_model
    found = battery.resolve(options.battery, robot)
    if options.hardware:
        found = battery.with_profile(found)
    if options.simulator != MUJOCO:
        return _simulated(options, found)
    if not options.hardware_config.is_customized:
        return found
    named = tuple(name for name in options.battery if name not in battery.BATTERIES)
    asked = [each.name for each in (battery.resolve(named, robot) if named else ()) if each.hardware]
    if options.hardware or asked:
        which = "--hardware" if options.hardware else f"--scenarios {' '.join(asked)}"
        raise UsageError(f"{which}: the profile has its own --actuator, --sensors and --estimator: leave these out")
    return tuple(each for each in found if not each.hardware)


def _simulated(options: EvaluateOptions, scenarios: Sequence[Scenario]) -> tuple[Scenario, ...]:
    """Of a battery the scenarios that the simulator can do, the others named on stderr. Raises UsageError for any
    scenario that is asked for by name."""
    beyond = {}
    for scenario in scenarios:
        try:
            hardware.check_hardware(options.hardware_config, scenario)
        except ValueError as error:
            beyond[scenario.name] = error
    left, words = [each for each in scenarios if each.name not in beyond], ", ".join(beyond)
    if beyond and (not left or not set(options.battery) <= set(battery.BATTERIES)):
        raise UsageError(f"--scenarios {words}: {next(iter(beyond.values()))}")
    if beyond:
        print(f"left out, since {options.simulator} cannot simulate them: {words}", file=sys.stderr)
    return tuple(left)


def policies_asked_for(
    names: tuple[str, ...], scenarios: Sequence[Scenario], hardware: HardwareConfig, trust: bool = False
) -> tuple[LabelledPolicy, ...]:
    """The policies of these names, each with the scenarios that it is limited to. Raises UsageError."""
    if not names:
        raise UsageError(f"--policies: none given; name at least one of {', '.join(policies.names())}, or a folder")
    if unlimited := [name for name in names if name.endswith("@")]:
        raise UsageError(f"--policies: name scenarios after the @ of {', '.join(unlimited)}, as in document@flat")
    asked = [_parts(name) for name in names]
    if names == DEFAULT_POLICIES:
        run = {scenario.name for scenario in scenarios}
        asked = [(label, only_on) for label, only_on in asked if not only_on or run.intersection(only_on)]
        asked = asked if hardware.robot == HardwareConfig.robot else _without_untrained(asked, hardware.robot_model)
    _check_distinct([label for label, _ in asked])
    _check_scenarios(asked, [scenario.name for scenario in scenarios])
    try:
        return tuple(load_labelled_policy(label, hardware, scenarios, trust, only) for label, only in asked)
    except policies.PolicyError as error:
        raise UsageError(f"--policies: {error}") from error


def _without_untrained(asked: list[tuple[str, tuple[str, ...]]], robot: Robot) -> list[tuple[str, tuple[str, ...]]]:
    """Leave out the default's trained policies that this robot lacks, named on stderr; SimpleQuad has all."""
    untrained = [label for label, _ in asked if policies.is_missing(label, robot)]
    if untrained:
        names = ", ".join(untrained)
        print(f"left out, since {robot.name} has no such trained policy: {names}", file=sys.stderr)
    return [each for each in asked if each[0] not in untrained]


def _parts(name: str) -> tuple[str, tuple[str, ...]]:
    """Label, and the scenarios that it is limited to; a folder's name may have an @ of its own."""
    label, _, scenarios = (name, "", "") if Path(name).is_dir() or policies.is_reference(name) else name.partition("@")
    known = label in policies.names()
    return label if known else label.rstrip("/\\") or label, tuple(filter(None, scenarios.split(",")))


def _check_distinct(labels: list[str]) -> None:
    places = [label if label in policies.names() else str(Path(label).resolve()) for label in labels]
    if repeated := sorted({label for label, place in zip(labels, places, strict=True) if places.count(place) > 1}):
        raise UsageError(f"--policies: {', '.join(repeated)} given more than once; name each policy once")


def _check_scenarios(asked: list[tuple[str, tuple[str, ...]]], scenarios: list[str]) -> None:
    for label, only_on in asked:
        if unknown := [name for name in only_on if name not in scenarios]:
            there = ", ".join(scenarios)
            raise UsageError(f"--policies: {label}@{','.join(unknown)} is not among the scenarios of this run: {there}")


def check_baseline(baseline: str | None, labels: Sequence[str]) -> None:
    """Raise UsageError unless the baseline is one of the policies."""
    if baseline is not None and baseline not in labels:
        raise UsageError(f"--baseline: {baseline} is not among the policies {', '.join(labels)}")


def _check_folder(out: Path) -> None:
    try:
        make_writable_folder(out)
    except OSError as error:
        raise UsageError(f"cannot write to the folder {out} ({error.strerror}); name another one with --out") from error
    _check_unused(out)
    if taken := [str(out / name) for name in FILES if (out / name).is_dir()]:
        raise UsageError(f"{', '.join(taken)} is to be a file, but is a folder; name another folder with --out")
    if (out / CHUNKS).exists() and not (out / CHUNKS).is_dir():
        raise UsageError(f"{out / CHUNKS} is to be a folder, but is a file; name another folder with --out")


def _check_unused(out: Path) -> None:
    """Raise FolderInUse, one line, while another run writes there."""
    with exclusive_lock(out):
        pass


def _resume_manifest(now: Manifest, options: EvaluateOptions) -> Manifest:
    """The manifest that the run was begun with. Raises UsageError unless it can go on as if it had never stopped."""
    then, asked = _begun(options.out)
    if differing := describe_changes(asked, options):
        said = f"--resume carries a run on as it was begun, but {'; '.join(differing)}"
        raise UsageError(f"{said}{_resume_remedy(asked, options)}")
    if differing := manifests.differences(then, now):
        raise UsageError(f"--resume carries a run on as it was begun, but {'; '.join(differing)}")
    if now.fingerprint != then.fingerprint:
        raise UsageError(f"{options.out / manifests.NAME} has been changed by hand; leave --resume out to begin again")
    return then


def _resume_remedy(then: EvaluateOptions, now: EvaluateOptions) -> str:
    """Return the remedy where more is asked of a run than at its start."""
    folder = shlex.quote(str(now.out))
    if added := [name for name in now.policies if name not in then.policies]:
        run = f"--policies {shlex.join(added)} --episodes {then.max_episodes} --seed {then.seed} --out ANOTHER"
        return (
            f". A run is not extended: evaluate with {run}, then `{PROGRAM} compare {folder} ANOTHER` ranks all of them"
        )
    if now.max_episodes > then.max_episodes or set(now.scenarios) > set(then.scenarios):
        return ". A run is not extended: leave --resume out and name another --out"
    return ""


def _begun(folder: Path) -> tuple[Manifest, EvaluateOptions]:
    """What the run in a folder was begun with. Raises UsageError."""
    try:
        manifest = manifests.read(folder)
        return manifest, replace(EvaluateOptions(out=folder), **options_from_json(manifest.options))
    except (OSError, UsageError, ValueError) as error:
        raise UsageError(f"--resume: {error}; leave --resume out to begin again") from error
