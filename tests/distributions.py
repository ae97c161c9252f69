"""The two distributions of the project, installed into environments with their requirements alone."""

import os
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterable, Mapping
from email.parser import HeaderParser
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def build(folder: Path, kind: str, out: Path) -> Path:
    """Return the wheel or the source distribution of the project in a folder."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", kind, "--directory", str(out)]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    (path,) = out.iterdir()
    return path


def description(wheel: Path) -> Mapping[str, list[str]]:
    """Return the metadata of a wheel: header -> its values."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        message = HeaderParser().parsestr(archive.read(name).decode())
    return {header: message.get_all(header, []) for header in message}


def needed(wheels: Iterable[Path], requirements: Iterable[str]) -> set[str]:
    """Return the names of all distributions that requirements bring, directly or not, apart from those of the wheels.

    What the wheels require is in them; what others require is in the environment of the tests.
    """
    own = {canonicalize_name(meta["Name"][0]): meta.get("Requires-Dist", []) for meta in map(description, wheels)}
    seen: set[tuple[str, str]] = set()
    waiting = [(requirement, "") for requirement in map(Requirement, requirements)]
    while waiting:
        requirement, extra_of_parent = waiting.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra_of_parent}):
            continue
        name = canonicalize_name(requirement.name)
        for extra in {"", *requirement.extras} - {extra for known, extra in seen if known == name}:
            seen.add((name, extra))
            lines = own[name] if name in own else metadata.requires(name) or []
            waiting += [(each, extra) for each in map(Requirement, lines)]
    return {name for name, _ in seen} - set(own)


def site_packages(environment: Path) -> Path:
    """Return the folder of the packages of a virtual environment."""
    (folder,) = (path for path in environment.rglob("site-packages") if path.is_dir())
    return folder


def python_of(environment: Path) -> Path:
    """Return the Python of a virtual environment."""
    return next(path for path in environment.glob("*/python*") if path.stem == "python")


def install(environment: Path, wheels: Iterable[Path], names: Iterable[str]) -> None:
    """Make a virtual environment with wheels and with distributions of the environment of the tests, as links.

    `pip` unpacks the wheels. Nothing is fetched, so that this works offline.
    """
    venv.create(environment, symlinks=os.name != "nt")
    folder = site_packages(environment)
    options = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check", "--target", str(folder)]
    for wheel in wheels:
        subprocess.run([sys.executable, "-m", "pip", "install", *options, str(wheel)], check=True)
    for name in names:
        distribution = metadata.distribution(name)
        for top_level in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            link = folder / top_level
            if not link.exists():
                link.symlink_to(Path(str(distribution.locate_file(top_level))))


def run(environment: Path, words: Iterable[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the Python of a virtual environment in a folder, without the variables of Python."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(python_of(environment)), *words]
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)
