"""`manifest.json`: all inputs that the results of a run depend on, written when the run starts.

`--resume` reads the file and checks that the inputs are still the same.
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
"""Names of the files of a finished run."""
CHUNKS = "parts"
"""Name of the folder with the finished chunks (parts of cells) of an unfinished run."""
SCHEMA = 1
"""Version of the keys in manifest.json."""
LAST_COMPATIBLE_REVISION = "revision 02bbde28"
"""Last revision that can read old results.

Old results are by the rules success/1 and energy/1 (version 0.2.0 and before), or have no causes of failures.
"""
_SHA256 = "sha256"
"""Key of the hash of all other entries in manifest.json."""
_NOT_PROVENANCE = ("options", "date", "fingerprint")
"""Fields of the manifest that no result depends on."""
_NOT_COMPARED = {"git_revision"}
"""Versions that are not compared, because the code digest already shows every change of the code."""
_NOT_IN_FINGERPRINT = _NOT_COMPARED | {"blas", "simd", "libc"}
"""Versions that do not enter the fingerprint, because results can be equal despite a difference.

The command `compare` reports a difference of all but the git revision.
"""


@dataclass(frozen=True)
class Manifest:
    """All inputs of a run, in which each policy runs its scenarios with the same seeds."""

    policies: Mapping[str, str]
    """Label -> digest (hash of classes, parameters and weights) of the policy, in the order of the run."""
    scenarios: tuple[Scenario, ...]
    seed: int
    """Evaluation seed."""
    episodes: int
    """Number of episodes in each cell; the number at the latest interim analysis if run --until settled."""
    steps: int
    """Control steps of an episode."""
    versions: Mapping[str, str | None]
    """Name -> version of each package, rule and library."""
    code: str
    """SHA-256 of the packages that the results depend on."""
    cpu: str
    """Name of the processor."""
    options: Mapping[str, Any]
    """Option name on the command line -> value; `--resume` reads the options from the manifest."""
    threads: int
    """Threads of the simulation; no result depends on their number."""
    hardware: HardwareConfig = IDEAL
    """Hardware of the robots."""
    only_on: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Label -> names of the scenarios to run, only for policies that do not run on all scenarios."""
    limit: int = 0
    """Maximum number of episodes in each cell of a run --until settled; 0 for other runs."""
    ended: str = ""
    """Reason for the end of a run --until settled; empty before the end and for other runs."""
    date: str = ""
    """Start date of the run, UTC; empty if it was not recorded."""
    fingerprint: str = ""
    """SHA-256 of all inputs that a result depends on, computed at the start of the run."""

    @property
    def cells(self) -> list[tuple[Scenario, str]]:
        """Scenario and policy of each cell, in the order of the run."""
        return [
            (scenario, policy)
            for scenario in self.scenarios
            for policy in self.policies
            if scenario.name in self.only_on.get(policy, (scenario.name,))
        ]

    @property
    def is_unsettled(self) -> bool:
        """True for a run --until settled that has not ended."""
        return bool(self.limit) and not self.ended

    def with_fingerprint(self) -> "Manifest":
        """Return a copy of the manifest, with the fingerprint computed."""
        return replace(self, fingerprint=_fingerprint(self.provenance()))

    def until_settled(self) -> "Manifest":
        """Return the manifest of a run --until settled at the first interim analysis.

        The number of episodes of this manifest becomes the limit.
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
        """Return field name -> JSON value, for all fields except options, date and fingerprint."""
        values = {name: value for name, value in vars(self).items() if name not in _NOT_PROVENANCE}
        return values | {"hardware": asdict(self.hardware), "scenarios": to_json_values(self.scenarios)}

    def write(self, folder: Path) -> None:
        """Write manifest.json into a folder."""
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
        options: Option name on the command line -> value.
        seed: Evaluation seed.
        episodes: Episodes of each policy on each scenario.
        steps: Control steps of an episode.
        threads: Threads of the simulation.
        hardware: Hardware of the robots.

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
    """Read the manifest of a folder.

    Args:
        folder: Results folder.

    Returns:
        The manifest.

    Raises:
        UsageError: There is no manifest of this version, it has been changed, or the robot file of the run is missing.
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
    """Parse a manifest file; raise UsageError if it has other rule versions or has been changed."""
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
    """Raise UsageError if the robot file of a run does not exist relative to the current folder.

    The message names the folder to change to.
    """
    if Path(robot).suffix not in SUFFIXES or Path(robot).is_file():
        return
    here = next((folder for folder in path.resolve().parents if (folder / robot).is_file()), None)
    remedy = "run this command in the folder in which the evaluation was run"
    remedy = remedy if here is None else f"run this command in {here}"
    raise UsageError(f"{path}: its robot {robot} is no file in {Path.cwd()}; {remedy}")


def _is_changed(contents: dict[str, Any]) -> bool:
    """Return True if the contents of manifest.json do not match the stored fingerprint and hash."""
    hashed = {name: value for name, value in contents.items() if name != _SHA256}
    provenance = {name: value for name, value in hashed.items() if name not in ("schema", *_NOT_PROVENANCE)}
    digest = _digest(hashed)
    return bool(contents["fingerprint"] != _fingerprint(provenance) or contents.get(_SHA256) != digest)


def _fingerprint(provenance: Mapping[str, Any]) -> str:
    """Return the SHA-256 of all inputs that a result depends on."""
    versions = {name: version for name, version in provenance["versions"].items() if name not in _NOT_IN_FINGERPRINT}
    inputs = {name: value for name, value in provenance.items() if name != "ended"}
    max_episodes = inputs.get("limit") or inputs["episodes"]
    return _digest({**inputs, "versions": versions, "threads": None, "episodes": max_episodes})


def _digest(values: Mapping[str, Any]) -> str:
    """Return the SHA-256 of JSON values, independent of the order of the keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def differences(then: Manifest, now: Manifest) -> list[str]:
    """Describe each input that differs between the runs `then` and `now`; options are not compared."""
    return list(_differences(then, now))


def _differences(then: Manifest, now: Manifest) -> Iterator[str]:
    """Yield a description of each difference between two manifests."""
    for name, version in then.versions.items():
        new = now.versions.get(name, version)  # older manifests do not have all versions
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
