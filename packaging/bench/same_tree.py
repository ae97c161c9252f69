"""Metadata hook of hatchling: `simple-quad-bench` needs `simple-quad` of the same version, and of the same tree.

A wheel for an index names the version. The wheel that pip builds from a git URL names this URL and commit, because an
index has no `simple-quad` of any commit.
"""

import os
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from hatchling.metadata.plugin.interface import MetadataHookInterface

REQUIRED_EXTRAS = "commands,bench"
"""Extras of `simple-quad` that `simple-quad-bench` always needs."""
EXTRAS = "train", "onnx", "robots", "drake", "warp", "cluster", "recording", "unitree", "video"
"""Extras of `simple-quad` that `simple-quad-bench` has too."""
PIP_FOLDER = re.compile(r"pip-[a-z-]+-\w{8}")
"""Name of a temporary folder in which pip unpacks or clones what it builds."""


class SameTree(MetadataHookInterface):
    """Sets version, dependencies and extras from the project `simple-quad`, two folders up."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the fields to the table `project` of pyproject.toml, `metadata`, in place."""
        root = Path(self.root).resolve().parents[1]
        text = (root / "pyproject.toml").read_text(encoding="utf-8")
        version = tomllib.loads(text)["project"]["version"]
        source = find_git_source(root) or f"=={version}"
        metadata["version"] = version
        metadata["dependencies"] = [f"simple-quad[{REQUIRED_EXTRAS}]{source}"]
        metadata["optional-dependencies"] = {extra: [f"simple-quad[{extra}]{source}"] for extra in EXTRAS}


def find_git_source(root: Path) -> str | None:
    """Return the end of a requirement that names URL and commit, such as ` @ git+https://host/quad@1f0c`.

    Args:
        root: Folder of the project.

    Returns:
        The text; None if the folder is not a clone that pip has made, or if its URL contains a password.
    """
    is_from_pip = any(map(PIP_FOLDER.fullmatch, (root.name, root.parent.name)))
    if "PIP_BUILD_TRACKER" not in os.environ or not is_from_pip or not (root / ".git").exists():
        return None
    url = _git(root, "config", "--get", "remote.origin.url")
    if "://" not in url or urlsplit(url).password:
        return None
    # pip 23 accepts only a requirement with a host in its URL.
    url = url.replace("file:///", "file://localhost/", 1)
    return f" @ git+{url}@{_git(root, 'rev-parse', 'HEAD')}"


def _git(folder: Path, *arguments: str) -> str:
    """Return what a git command prints for a folder, without white space at its ends."""
    done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()
