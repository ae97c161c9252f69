"""manifest.json: all inputs that the results of a run depend on, written when the run starts.

`--resume` reads the file, and checks that the inputs are still the same.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from evaluate.cells import LabelledPolicy
from evaluate.hardware import IDEAL, HardwareConfig, parse_robot_option
from evaluate.records.provenance import RULES, code_digest, cpu_model, hardware_versions, policy_digest, versions
from evaluate.statistics.sequential import looks
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically
from quad_env.robots.registry import SUFFIXES
from quad_env.scenarios.registry import Scenario
from quad_env.serialisation import from_json_values, to_json_values

NAME = "manifest.json"
FILES = ("results.json", "episodes.parquet", "report.html", NAME)
"""Names of the files in the results folder of a finished run."""
CHUNKS = "parts"
"""Name of the folder with the finished chunks (subsets of episodes) of an unfinished run."""
SCHEMA = 1
"""Version of the format of manifest.json."""
LAST_COMPATIBLE_REVISION = "revision 02bbde28"
"""Last revision of this project that can read results of old versions.

Old results use the rules success/1 and energy/1 (version 0.2.0 and before), or have no causes of failure.
"""
_SHA256 = "sha256"
"""Key in manifest.json of the hash of all its other keys and values."""
_NOT_PROVENANCE = ("options", "date", "fingerprint")
"""Names of the fields of the manifest that no result depends on."""
_NOT_COMPARED = {"git_revision"}
"""Names of versions that are not compared, because the hash of the code already shows every change."""
_NOT_IN_FINGERPRINT = _NOT_COMPARED | {"blas", "simd", "libc"}
"""Names of versions that do not enter the fingerprint, because they need not affect the results.

The command `compare` reports a difference in all of them except the git revision.
"""


@dataclass(frozen=True)
class Manifest:
    """All inputs of a run, in which every policy runs its scenarios with the same seeds."""

    policies: Mapping[str, str]
    """Label of a policy -> hash of its classes, parameters and weights, in the order of the run."""
    scenarios: tuple[Scenario, ...]
    seed: int
    """Evaluation seed of the run, from which the seeds of all episodes are derived."""
    episodes: int
    """Number of episodes of each policy on each scenario.

    In a run --until settled, it is the number at the latest interim analysis.
    """
    steps: int
    """Maximum number of control steps of an episode."""
    versions: Mapping[str, str | None]
    """Name of a package, rule or library -> its version; None if the version is not known."""
    code: str
    """SHA-256 of the code of the packages that the results depend on."""
    cpu: str
    """Name of the processor, on which the last bits of the results depend."""
    options: Mapping[str, Any]
    """Name of a command-line option -> its value; `--resume` reads the options from here."""
    threads: int
    """Number of processes or threads of the simulation; no result depends on it."""
    hardware: HardwareConfig = IDEAL
    """Names of robot, servo gains, motors, sensors, estimator and simulator."""
    only_on: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Label of a policy -> names of the scenarios that it is restricted to.

    Policies that run on all scenarios are left out.
    """
    limit: int = 0
    """Maximum number of episodes per policy and scenario of a run --until settled; 0 for other runs."""
    ended: str = ""
    """Reason for the end of a run --until settled; empty before its end and for other runs."""
    date: str = ""
    """Date on which the run started, UTC; empty if it was not recorded."""
    fingerprint: str = ""
    """Fingerprint: SHA-256 of all inputs that a result depends on, computed at the start of the run."""

    @property
    def cells(self) -> list[tuple[Scenario, str]]:
        """Scenario and policy label of each result of the run, in the order of the run."""
        return [
            (scenario, policy)
            for scenario in self.scenarios
            for policy in self.policies
            if scenario.name in self.only_on.get(policy, (scenario.name,))
        ]

    @property
    def is_unsettled(self) -> bool:
        """True for a run --until settled that has not ended yet."""
        return bool(self.limit) and not self.ended

    def with_fingerprint(self) -> "Manifest":
        """Return a copy of the manifest in which the field `fingerprint` is computed from the inputs."""
        return replace(self, fingerprint=_fingerprint(self.provenance()))

    def until_settled(self) -> "Manifest":
        """Return the manifest of the same run as a run --until settled, at its first interim analysis.

        The number of episodes of this manifest becomes the maximum number of episodes.
        """
        return replace(self, limit=self.episodes, episodes=looks(self.episodes)[0]).with_fingerprint()

    def as_json(self) -> dict[str, Any]:
        """Return the contents of manifest.json: key -> JSON value."""
        contents = {
            "schema": SCHEMA,
            "fingerprint": self.fingerprint,
            "date": self.date,
            "options": dict(self.options),
            **self.provenance(),
        }
        return {**contents, _SHA256: _digest(contents)}

    def provenance(self) -> dict[str, Any]:
        """Return all fields except options, date and fingerprint: name -> JSON value."""
        values = {name: value for name, value in vars(self).items() if name not in _NOT_PROVENANCE}
        return values | {"hardware": asdict(self.hardware), "scenarios": to_json_values(self.scenarios)}

    def write(self, folder: Path) -> None:
        """Write the manifest as manifest.json into the results `folder`."""
        write_atomically(folder / NAME, (json.dumps(self.as_json(), indent=2) + "\n").encode())


def manifest(
    policies: Sequence[LabelledPolicy],
    scenarios: Sequence[Scenario],
    options: Mapping[str, Any],
    *,
    seed: int,
    episodes: int,
    steps: int,
    threads: int,
    hardware: HardwareConfig = IDEAL,
) -> Manifest:
    """Make the manifest of a run that starts now on this machine.

    Args:
        policies: Policies in the order of the run.
        scenarios: Scenarios in the order of the run.
        options: Name of a command-line option -> its value.
        seed: Evaluation seed of the run.
        episodes: Number of episodes of each policy on each scenario.
        steps: Maximum number of control steps of an episode.
        threads: Number of processes or threads of the simulation.
        hardware: Names of robot, servo gains, motors, sensors, estimator and simulator.

    Returns:
        The manifest with its fingerprint.
    """
    return Manifest(
        policies={policy.label: policy_digest(*policy.variants) for policy in policies},
        scenarios=tuple(scenarios),
        seed=seed,
        episodes=episodes,
        steps=steps,
        versions=versions() | hardware_versions(hardware),
        code=code_digest(),
        cpu=cpu_model(),
        options=options,
        threads=threads,
        hardware=hardware,
        only_on={policy.label: policy.only_on for policy in policies if policy.only_on},
        date=datetime.now(UTC).date().isoformat(),
    ).with_fingerprint()


def read(folder: Path) -> Manifest:
    """Read and check the manifest of a results folder.

    Args:
        folder: Results folder.

    Returns:
        The manifest.

    Raises:
        UsageError: The folder has no manifest of this version, the manifest has been changed, or the robot file of the
            run is missing.
    """
    path = folder / NAME
    if not path.is_file():
        raise UsageError(f"{folder} is no folder with results of `python -m evaluate`: it has no {NAME}")
    try:
        manifest = _parse(path)
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no manifest of this version ({error})") from error
    _check_robot_file(path, manifest.hardware.robot)
    parse_robot_option(manifest.hardware.robot, f"{path}: its robot")
    return manifest


def _parse(path: Path) -> Manifest:
    """Parse the manifest file at `path`.

    UsageError is raised if the run used other rule versions, or if the file has been changed.
    """
    contents = parse_json(read_bytes(path))
    if type(contents["schema"]) is not int or contents["schema"] != SCHEMA:
        raise ValueError("it is of another schema")
    if not RULES.items() <= dict(contents["versions"]).items():
        rules = ", ".join(RULES.values())
        raise UsageError(
            f"{path}: its figures are not by {rules}, this version's rules; {LAST_COMPATIBLE_REVISION} reads older ones"
        )
    if _is_changed(contents):
        raise UsageError(f"{path} has been changed since it was written: restore it, or run the evaluation again")
    values = {name: value for name, value in contents.items() if name not in ("schema", _SHA256)}
    values["scenarios"] = from_json_values(contents["scenarios"])
    values["hardware"] = HardwareConfig(**contents["hardware"])
    return Manifest(**values)


def _check_robot_file(path: Path, robot: str) -> None:
    """Check that the robot file of a run exists relative to the current folder.

    Args:
        path: Path of the manifest.
        robot: Name of the robot, or path of its file.

    Raises:
        UsageError: The file does not exist; the message names the folder in which to run the command.
    """
    if Path(robot).suffix not in SUFFIXES or Path(robot).is_file():
        return
    here = next((folder for folder in path.resolve().parents if (folder / robot).is_file()), None)
    remedy = "run this command in the folder in which the evaluation was run"
    remedy = remedy if here is None else f"run this command in {here}"
    raise UsageError(f"{path}: its robot {robot} is no file in {Path.cwd()}; {remedy}")


def _is_changed(contents: dict[str, Any]) -> bool:
    """Return True if the JSON `contents` of manifest.json do not match their stored fingerprint and hash."""
    hashed = {name: value for name, value in contents.items() if name != _SHA256}
    provenance = {name: value for name, value in hashed.items() if name not in ("schema", *_NOT_PROVENANCE)}
    digest = _digest(hashed)
    return bool(contents["fingerprint"] != _fingerprint(provenance) or contents.get(_SHA256) != digest)


def _fingerprint(provenance: Mapping[str, Any]) -> str:
    """Return the fingerprint of a run: the SHA-256 of all inputs in `provenance` that a result depends on."""
    versions = {name: version for name, version in provenance["versions"].items() if name not in _NOT_IN_FINGERPRINT}
    inputs = {name: value for name, value in provenance.items() if name != "ended"}
    max_episodes = inputs.get("limit") or inputs["episodes"]
    return _digest({**inputs, "versions": versions, "threads": None, "episodes": max_episodes})


def _digest(values: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a dictionary of JSON values; it does not depend on the order of the keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def differences(then: Manifest, now: Manifest) -> list[str]:
    """Describe each input that differs between two runs; command-line options are not compared.

    Args:
        then: Manifest of the earlier run.
        now: Manifest of the present run.

    Returns:
        A text for each difference, for example `numpy was 2.0 and is 2.1`.
    """
    return list(_differences(then, now))


def _differences(then: Manifest, now: Manifest) -> Iterator[str]:
    """Yield a description of each input that differs between the manifests `then` and `now`."""
    for name, version in then.versions.items():
        new = now.versions.get(name, version)  # the old version by default, because older manifests lack some versions
        if name not in _NOT_COMPARED and new != version:
            yield f"{name} was {version} and is {new}"
    if then.code != now.code:
        yield "the code of quad_env, policies or evaluate has changed"
    if then.cpu != now.cpu:
        yield f"the processor was {then.cpu} and is {now.cpu}"
    if then.steps != now.steps:
        yield f"an episode had {then.steps} steps and has {now.steps}"
    for part, name in asdict(then.hardware).items():
        if (new := getattr(now.hardware, part)) != name:
            yield f"{part} was {name} and is {new}"
    for name, digest in then.policies.items():
        if now.policies.get(name, digest) != digest:
            yield f"the policy {name} has changed"
    scenarios = {scenario.name: scenario for scenario in now.scenarios}
    for scenario in then.scenarios:
        if scenarios.get(scenario.name, scenario) != scenario:
            yield f"the scenario {scenario.name} has changed"
