"""The file manifest.json of an evaluation (run): all inputs on which its results depend.

The file is written when the run starts. The option `--resume` continues an interrupted run; it reads the file, and
checks that the inputs are still the same.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.cells import LabelledPolicy
from evaluate.hardware import IDEAL, HardwareConfig, parse_robot_option
from evaluate.records.provenance import RULES, code_digest, cpu_model, hardware_versions, policy_digest, versions
from evaluate.records.shares import Share, share_from_json
from evaluate.statistics.sequential import looks
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically
from quad_env.robots.registry import SUFFIXES
from quad_env.scenarios.registry import Scenario
from quad_env.serialisation import from_json_values, to_json_values

NAME = "manifest.json"
"""Name of the file in a results folder that contains all inputs of the evaluation."""
FILES = ("results.json", "episodes.parquet", "report.html", NAME)
"""Names of the files in the results folder of a finished evaluation."""
CHUNKS = "parts"
"""Name of the subfolder of a results folder with the finished episodes of an unfinished evaluation.

Each file contains a chunk: a subset of the episodes of one policy on one scenario.
"""
SCHEMA = 1
"""Version of the format of manifest.json, which is stored under the key `schema`."""
LAST_COMPATIBLE_REVISION = "revision 02bbde28"
"""Last git revision of this project that can read results of old versions, for an error message.

Old results use the rules success/1 and energy/1 (version 0.2.0 and before), or have no causes of failure.
"""
_SHA256 = "sha256"
"""Key in manifest.json for the SHA-256 of all other keys and values, which shows a change of the file."""
_NOT_PROVENANCE = ("options", "date", "fingerprint", "share")
"""Names of the fields of a manifest that have no influence on the results of the evaluation."""
_OUTCOME = ("ended", "out_of_time")
"""Names of the fields that describe the end of a run with a variable number of episodes."""
NOT_COMPARED = {"git_revision"}
"""Names of the software versions that are not compared between two runs (evaluations).

The git revision is not compared because the hash of the code already shows every change of the code.
"""
_NOT_IN_FINGERPRINT = NOT_COMPARED | {"blas", "simd", "libc"}
"""Names of the software versions that do not enter the fingerprint (hash of all inputs) of an evaluation.

These versions do not always affect the results. The command `compare` reports a difference in all of them except the
git revision.
"""


@dataclass(frozen=True)
class Manifest:
    """All inputs of an evaluation (run) on which its results depend, as stored in manifest.json."""

    policies: Mapping[str, str]
    """Label of a policy -> hash of its classes, parameters and network weights, in the order of the run.

    The label is the name or path that the user gave on the command line.
    """
    scenarios: tuple[Scenario, ...]
    """Scenarios of the run, in the order in which they are simulated and reported."""
    seed: int
    """Evaluation seed that the user chose, from which the seeds of all episodes are derived."""
    episodes: int
    """Number of episodes of each policy on each scenario.

    A run with `--until settled` or `--minutes` adds episodes until adjacent policies of the ranking are distinguished.
    The value is then the number of episodes at the latest interim analysis, or after the latest round.
    """
    steps: int
    """Number of control steps after which an episode ends at the latest (its time limit)."""
    versions: Mapping[str, str | None]
    """Name of a package, rule or library -> its version in this run; None if the version is not known."""
    code: str
    """SHA-256 of the code of this project's packages on which the results depend."""
    cpu: str
    """Name of the processor of the machine; the last bits of the results depend on the processor."""
    options: Mapping[str, Any]
    """Name of a command-line option -> its value when the run started; `--resume` reads these values."""
    threads: int
    """Number of parallel processes or threads of the simulation; it has no influence on the results."""
    hardware: HardwareConfig = IDEAL
    """Hardware of the simulated robots: robot, servo gains, motors, sensors, estimator and simulator."""
    only_on: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Label of a policy -> names of the scenarios to which the policy is restricted.

    Policies that run on all scenarios are left out.
    """
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Name of a group of training seeds -> labels of its policies; empty for a run without groups."""
    limit: int = 0
    """Maximum number of episodes of each policy on each scenario in a run with `--until settled` or `--minutes`.

    This run adds episodes until adjacent policies of the ranking are distinguished. The value is 0 for a run with a
    fixed number of episodes.
    """
    ended: str = ""
    """Reason why a run with `--until settled` or `--minutes` ended; empty before its end, and for all other runs.

    This run adds episodes until adjacent policies of the ranking are distinguished.
    """
    minutes: float = 0.0
    """Time limit of a run with `--minutes`, min; 0 for a run without a time limit."""
    out_of_time: bool = False
    """True if the time limit ended the run. The number of episodes then depends on the speed of the machine."""
    date: str = ""
    """Date on which the run started, UTC; empty if it was not recorded."""
    fingerprint: str = ""
    """Fingerprint of the run: SHA-256 of all inputs on which the results depend, computed at its start.

    All parts of a run (`--part`) have the fingerprint of the whole run.
    """
    share: Share | None = None
    """Episodes of this part of a run, for `--part`; None for a whole run."""

    @property
    def cells(self) -> list[tuple[Scenario, str]]:
        """All pairs of a scenario and the label of a policy that runs on it, in the order of the run.

        For a part of a run, scenarios without episodes in this part are left out.
        """
        return [
            (scenario, policy)
            for scenario in self.scenarios
            for policy in self.policies
            if scenario.name in self.only_on.get(policy, (scenario.name,)) and len(self.episode_indices(scenario.name))
        ]

    @property
    def episode_count(self) -> int:
        """Number of all episodes of this run, or of this part of a run."""
        return sum(len(self.episode_indices(scenario.name)) for scenario, _ in self.cells)

    def episode_indices(self, scenario: str) -> NDArray[np.int64]:
        """Return the indices of the episodes of each policy on a scenario, (n,): all, or the share of a part of a run.

        Args:
            scenario: Name of the scenario.

        Returns:
            The indices in ascending order.
        """
        return np.arange(self.episodes) if self.share is None else self.share.episode_indices(scenario)

    @property
    def is_unsettled(self) -> bool:
        """True for a run with a variable number of episodes (`--until settled`, `--minutes`) that has not ended."""
        return bool(self.limit) and not self.ended

    def with_fingerprint(self) -> "Manifest":
        """Return a copy of the manifest with its fingerprint, the SHA-256 of all inputs of the run."""
        return replace(self, fingerprint=_fingerprint(self.provenance()))

    def with_groups(self, groups: Mapping[str, Sequence[str]]) -> "Manifest":
        """Return a copy of the manifest with groups of training seeds: name -> labels of the policies."""
        return replace(self, groups={name: list(labels) for name, labels in groups.items()}).with_fingerprint()

    def until_settled(self) -> "Manifest":
        """Convert the manifest of a run with a fixed number of episodes to a run with `--until settled`.

        This run adds episodes until adjacent policies of the ranking are distinguished. The fixed number of episodes
        becomes the maximum number of episodes. The number of episodes becomes the number at the first interim analysis.
        """
        return replace(self, limit=self.episodes, episodes=looks(self.episodes)[0]).with_fingerprint()

    def with_time_limit(self, minutes: float, first_round: int) -> "Manifest":
        """Convert the manifest of a run with a fixed number of episodes to a run with a time limit.

        The fixed number of episodes becomes the maximum number. The run starts with the episodes of the first round.

        Args:
            minutes: Time limit, min.
            first_round: Number of episodes of each policy on each scenario in the first round.

        Returns:
            The manifest.
        """
        episodes = min(first_round, self.episodes)
        return replace(self, limit=self.episodes, episodes=episodes, minutes=minutes).with_fingerprint()

    def as_json(self) -> dict[str, Any]:
        """Return the contents of the file manifest.json, with hashes to detect changes: key -> JSON value."""
        contents = {
            "schema": SCHEMA,
            "fingerprint": self.fingerprint,
            "date": self.date,
            "options": dict(self.options),
            **({} if self.share is None else {"share": self.share.as_json()}),
            **self.provenance(),
        }
        return {**contents, _SHA256: _digest(contents)}

    def provenance(self) -> dict[str, Any]:
        """Return the origin of the results, the fields on which the results depend: name -> value."""
        values = {name: value for name, value in vars(self).items() if name not in _NOT_PROVENANCE}
        return values | {"hardware": asdict(self.hardware), "scenarios": to_json_values(self.scenarios)}

    def write(self, folder: Path) -> None:
        """Write the manifest as the file manifest.json into the results folder `folder`."""
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
    """Make the manifest (all inputs) of an evaluation that starts now on this machine.

    Args:
        policies: Policies with their labels, in the order of the evaluation.
        scenarios: Scenarios, in the order of the evaluation.
        options: Name of a command-line option -> its value.
        seed: Evaluation seed that the user chose.
        episodes: Number of episodes of each policy on each scenario.
        steps: Number of control steps after which an episode ends at the latest.
        threads: Number of parallel processes or threads of the simulation.
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
    """Read the file manifest.json (all inputs of an evaluation) in a results folder, and check it.

    Args:
        folder: Results folder of the evaluation.

    Returns:
        The manifest.

    Raises:
        UsageError: The folder has no manifest.json of this version, the file has been changed, or the robot's file is
            missing.
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
    """Parse a file manifest.json, and check its hashes.

    Args:
        path: Path of the file.

    Returns:
        The manifest.

    Raises:
        ValueError: The file has another version of the format than SCHEMA.
        UsageError: The evaluation used other versions of the rules for success, energy or causes, or the file has been
            changed.
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
    if "share" in contents:
        values["share"] = share_from_json(contents["share"])
    return Manifest(**values)


def _check_robot_file(path: Path, robot: str) -> None:
    """Check that the robot's file exists, if an evaluation used a robot from a file.

    The path of the file is relative to the folder in which the evaluation was run.

    Args:
        path: Path of the file manifest.json.
        robot: Name of a built-in robot, or path of the file that describes the robot.

    Raises:
        UsageError: The file does not exist. The message names the folder in which the command must be run.
    """
    if Path(robot).suffix not in SUFFIXES or Path(robot).is_file():
        return
    here = next((folder for folder in path.resolve().parents if (folder / robot).is_file()), None)
    remedy = "run this command in the folder in which the evaluation was run"
    remedy = remedy if here is None else f"run this command in {here}"
    raise UsageError(f"{path}: its robot {robot} is no file in {Path.cwd()}; {remedy}")


def _is_changed(contents: dict[str, Any]) -> bool:
    """Return True if a file manifest.json was changed: its `contents` do not match their stored hashes."""
    hashed = {name: value for name, value in contents.items() if name != _SHA256}
    provenance = {name: value for name, value in hashed.items() if name not in ("schema", *_NOT_PROVENANCE)}
    digest = _digest(hashed)
    return bool(contents["fingerprint"] != _fingerprint(provenance) or contents.get(_SHA256) != digest)


def _fingerprint(provenance: Mapping[str, Any]) -> str:
    """Return the fingerprint of a run: the SHA-256 of all inputs on which its results depend.

    Args:
        provenance: Fields of the manifest except those in `_NOT_PROVENANCE`: name -> JSON value.

    Returns:
        The hash. It does not depend on the number of threads. It stays the same while a run with `--until settled` or
        `--minutes` adds episodes until adjacent policies of the ranking are distinguished.
    """
    versions = {name: version for name, version in provenance["versions"].items() if name not in _NOT_IN_FINGERPRINT}
    inputs = {name: value for name, value in provenance.items() if name not in _OUTCOME}
    max_episodes = inputs.get("limit") or inputs["episodes"]
    return _digest({**inputs, "versions": versions, "threads": None, "episodes": max_episodes})


def _digest(values: Mapping[str, Any]) -> str:
    """Return the SHA-256 of `values`, a dictionary of JSON values; the order of the keys has no influence."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def differences(then: Manifest, now: Manifest) -> list[str]:
    """Describe in words each input that differs between two evaluations, apart from command-line options.

    Args:
        then: Manifest (all inputs) of the earlier evaluation.
        now: Manifest of the present evaluation.

    Returns:
        A text for each difference, for example `numpy was 2.0 and is 2.1`.
    """
    return list(_differences(then, now))


def _differences(then: Manifest, now: Manifest) -> Iterator[str]:
    """Describe in words each input that differs between two evaluations: `numpy was 2.0 and is 2.1`.

    Args:
        then: Manifest (all inputs) of the earlier evaluation.
        now: Manifest of the present evaluation.

    Yields:
        Description of one difference.
    """
    for name, version in then.versions.items():
        # A version that only one manifest has is no difference, because older manifests lack some versions.
        new = now.versions.get(name, version)
        if name not in NOT_COMPARED and new != version:
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
