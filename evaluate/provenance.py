"""What the figures were made with."""

import hashlib
import json
import platform
import subprocess
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from policies.base import Policy
from policies.residual import ResidualPolicy
from quad_env.config import FallRule

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = ("quad_env", "policies", "evaluate")
"""Packages that the figures depend on."""
_KINDS = {".py", ".xml", ".json"}


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on, and the git revision, None outside a repository."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        **{name: metadata.version(name) for name in ("mujoco", "numpy", "scipy", "gymnasium", "pyarrow")},
        "quad_env": _version_of("simple-quad"),
        "fall_rule": FallRule().name,
        "git_revision": git_revision(REPOSITORY),
    }


def git_revision(folder: Path) -> str | None:
    """The commit of a checkout, with `-dirty` if tracked files differ from it; None if there is none."""
    revision = _git(folder, "rev-parse", "HEAD")
    if revision is None:
        return None
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else revision


def cpu_model() -> str:
    """What the processor calls itself: another one may round the last bit of a function differently."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


@cache
def code_digest() -> str:
    """SHA-256 of the packages that the figures depend on, names and contents: a commit may change nothing of them."""
    digest = hashlib.sha256()
    for path in _sources():
        content = path.read_bytes()
        digest.update(f"{path.relative_to(REPOSITORY).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def policy_digest(policy: Policy) -> str:
    """SHA-256 of what defines a policy: its weights if it has any, its parameters, its kind."""
    digest = hashlib.sha256(json.dumps(_defined_by(policy), sort_keys=True).encode())
    if isinstance(policy, ResidualPolicy):
        for array in (*policy.network.weights, *policy.network.biases, policy.authority):
            digest.update(array.tobytes())
    return digest.hexdigest()


def _defined_by(policy: Policy) -> dict[str, Any]:
    """A policy without its weights, as JSON values."""
    described: dict[str, Any] = {"kind": f"{type(policy).__module__}.{type(policy).__qualname__}"}
    if parameters := getattr(policy, "parameters", None):
        described["parameters"] = asdict(parameters)
    if isinstance(policy, ResidualPolicy):
        described["network"] = [list(policy.network.sizes), policy.network.activation]
        described["base"] = _defined_by(policy.base)
    return described


def _sources() -> Iterator[Path]:
    for package in SOURCES:
        yield from sorted(path for path in (REPOSITORY / package).rglob("*") if path.suffix in _KINDS)


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        finished = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return finished.stdout.strip() if finished.returncode == 0 else None


def _version_of(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
