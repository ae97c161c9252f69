"""`manifest.json`: what a run's figures depend on, written with its first episodes so that it can go on later."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from evaluate.cells import LabelledPolicy
from evaluate.hardware import IDEAL, HardwareConfig, parse_robot_option
from evaluate.records.provenance import RULES, code_digest, cpu_model, model_of, policy_digest, versions
from evaluate.statistics.sequential import looks
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically
from quad_env.robots.registry import SUFFIXES
from quad_env.scenarios.named import Scenario
from quad_env.serialisation import from_plain, to_json_values

NAME = "manifest.json"
FILES = ("results.json", "episodes.parquet", "report.html", NAME)
"""What a comparison leaves in its folder."""
CHUNKS = "parts"
"""Folder of the chunks of cells, while a run is going on."""
SCHEMA = 1
LAST_COMPATIBLE_REVISION = "revision 02bbde28"
"""Version that reads results by success/1 and energy/1, as of 0.2.0 and before, and without causes."""
_SHA256 = "sha256"
"""Key of the hash of all else in the file."""
_OF_NO_FIGURE = ("options", "date", "fingerprint")
"""What no figure depends on."""
_NOT_COMPARED = {"git_revision"}
"""Versions that may change without a figure changing: the code's digest says whether one could."""
_NOT_IN_FINGERPRINT = _NOT_COMPARED | {"blas", "simd", "libc"}
"""Versions with which the same run may come out to the same bytes; `compare` names them where they differ."""


@dataclass(frozen=True)
class Manifest:
    """A run: every policy on each of its scenarios with the same seeds."""

    policies: Mapping[str, str]
    """Label -> SHA-256 of what defines the policy, in the order of the run."""
    scenarios: tuple[Scenario, ...]
    seed: int
    episodes: int
    """Episodes of each policy on each scenario; in a run --until settled as of its last look."""
    steps: int
    """Control steps of an episode."""
    versions: Mapping[str, str | None]
    code: str
    """SHA-256 of the packages that the figures depend on."""
    cpu: str
    """The processor's name for itself."""
    options: Mapping[str, Any]
    """Options of the command line by name, so that --resume needs none of them again."""
    threads: int
    """Threads of the simulation; no figure depends on it."""
    hardware: HardwareConfig = IDEAL
    """Hardware of the robots."""
    only_on: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Label -> names of the scenarios of a policy that does not run on all of them."""
    limit: int = 0
    """Most episodes of a run --until settled; 0 of any other."""
    ended: str = ""
    """Why a run --until settled has ended, in words."""
    date: str = ""
    """Day on which the run began, UTC; empty where it was not written down."""
    fingerprint: str = ""
    """SHA-256 of all that a figure depends on, as it was written when the run began."""

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
        """Whether it is a run --until settled that has not ended."""
        return bool(self.limit) and not self.ended

    def with_fingerprint(self) -> "Manifest":
        """With its fingerprint."""
        return replace(self, fingerprint=_fingerprint(self.provenance()))

    def as_json(self) -> dict[str, Any]:
        """The contents of the file."""
        with_fingerprint = {"fingerprint": self.fingerprint, "date": self.date, "options": dict(self.options)}
        contents = {"schema": SCHEMA, **with_fingerprint, **self.provenance()}
        return {**contents, _SHA256: _digest(contents)}

    def provenance(self) -> dict[str, Any]:
        """All but the options, the date and the fingerprint, as JSON values."""
        kept = {name: value for name, value in vars(self).items() if name not in _OF_NO_FIGURE}
        return kept | {"hardware": asdict(self.hardware), "scenarios": to_json_values(self.scenarios)}

    def write(self, folder: Path) -> None:
        """Write the file."""
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
    limit: int = 0,
) -> Manifest:
    """Manifest of a run of these here and now; with a limit it is one until settled, of at most so many episodes."""
    return Manifest(
        policies={policy.label: policy_digest(*policy.variants) for policy in policies},
        scenarios=tuple(scenarios),
        seed=seed,
        episodes=looks(limit)[0] if limit else episodes,
        limit=limit,
        steps=steps,
        versions=versions() | model_of(hardware),
        code=code_digest(),
        cpu=cpu_model(),
        options=options,
        threads=threads,
        hardware=hardware,
        only_on={policy.label: policy.only_on for policy in policies if policy.only_on},
        date=datetime.now(UTC).date().isoformat(),
    ).with_fingerprint()


def read(folder: Path) -> Manifest:
    """The manifest of a folder. Raises UsageError, one line, if there is none or none of this version, or if it is not
    as it was written."""
    path = folder / NAME
    if not path.is_file():
        raise UsageError(f"{folder} is no folder with results of `python -m evaluate`: it has no {NAME}")
    try:
        found = parse_json(read_bytes(path))
        if type(found["schema"]) is not int or found["schema"] != SCHEMA:
            raise ValueError("it is of another schema")
        if not RULES.items() <= dict(found["versions"]).items():
            rules = ", ".join(RULES.values())
            raise UsageError(
                f"{path}: its figures are not by {rules}, this version's rules; "
                f"{LAST_COMPATIBLE_REVISION} reads older ones"
            )
        if _is_changed(found):
            raise UsageError(f"{path} has been changed since it was written: restore it, or run the evaluation again")
        values = {name: value for name, value in found.items() if name not in ("schema", _SHA256)}
        made = {"scenarios": from_plain(found["scenarios"]), "hardware": HardwareConfig(**found["hardware"])}
        manifest = Manifest(**(values | made))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no manifest of this version ({error})") from error
    _check_robot_file(path, manifest.hardware.robot)
    parse_robot_option(manifest.hardware.robot, f"{path}: its robot")
    return manifest


def _check_robot_file(path: Path, robot: str) -> None:
    """Raise UsageError, one line with the folder to change to, if the robot file of a run is not here."""
    if Path(robot).suffix not in SUFFIXES or Path(robot).is_file():
        return
    here = next((folder for folder in path.resolve().parents if (folder / robot).is_file()), None)
    remedy = "run this command in the folder in which the evaluation was run"
    remedy = remedy if here is None else f"run this command in {here}"
    raise UsageError(f"{path}: its robot {robot} is no file in {Path.cwd()}; {remedy}")


def _is_changed(found: dict[str, Any]) -> bool:
    """Whether the contents of a file are other than those that its fingerprint and its hash are of."""
    contents = {name: value for name, value in found.items() if name != _SHA256}
    provenance = {name: value for name, value in contents.items() if name not in ("schema", *_OF_NO_FIGURE)}
    digest = _digest(contents)
    return bool(found["fingerprint"] != _fingerprint(provenance) or found.get(_SHA256) != digest)


def _fingerprint(provenance: Mapping[str, Any]) -> str:
    """SHA-256 of all that a figure depends on."""
    known = {name: version for name, version in provenance["versions"].items() if name not in _NOT_IN_FINGERPRINT}
    with_fingerprint = {name: value for name, value in provenance.items() if name != "ended"}
    most = with_fingerprint.get("limit") or with_fingerprint["episodes"]
    return _digest({**with_fingerprint, "versions": known, "threads": None, "episodes": most})


def _digest(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def differences(then: Manifest, now: Manifest) -> list[str]:
    """What may make figures of one run differ from those of the other, in words; the options aside."""
    return list(_differences(then, now))


def _differences(then: Manifest, now: Manifest) -> Iterator[str]:
    for name, version in then.versions.items():
        new = now.versions.get(name, version)  # older results do not name all that newer ones do
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
