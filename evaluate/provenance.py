"""What the figures were made with."""

import platform
import subprocess
from importlib import metadata
from pathlib import Path

from quad_env.config import FallRule

REPOSITORY = Path(__file__).resolve().parents[1]


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on, and the git revision, None outside a repository."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "mujoco": metadata.version("mujoco"),
        "numpy": metadata.version("numpy"),
        "gymnasium": metadata.version("gymnasium"),
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
