"""Distributions: the wheel contains only quad_env, packages import only allowed packages, every dependency is used."""

import ast
import contextlib
import importlib
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.distributions import build, run, site_packages

EVALUATION = ("quad_env", "policies", "evaluate")
PACKAGES = (*EVALUATION, "train")
VIEW = "live/view"  # part of a clone with the base dependencies only; other commands of live name the missing package
INDIRECT = {"tensorboard"}  # torch.utils.tensorboard imports it when a training run logs
MAKE = """
import sys, gymnasium
env = gymnasium.make("quad_env:SimpleQuad-v0")
observation, info = env.reset(seed=0)
assert env.observation_space.contains(env.step(env.action_space.sample())[0])
assert gymnasium.make_vec("SimpleQuad-v0", num_envs=2).num_envs == 2
import quad_env
print(quad_env.__version__, quad_env.__file__)
from quad_env.__main__ import main
assert [main(words) for words in (["info"], ["describe", "simple_quad"], ["doctor"])] == [0, 0, 0]
"""


def project(repository: Path) -> dict[str, Any]:
    """Return the project table of pyproject.toml."""
    return tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def imported(package: Path) -> Iterator[str]:
    """Return the top-level names of all imports in a package's modules."""
    for module in package.rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                yield node.module.partition(".")[0]


@cache
def distributions() -> Mapping[str, list[str]]:
    """Return the distributions by import name; the call takes seconds."""
    return packages_distributions()


def third_party(repository: Path, packages: tuple[str, ...]) -> dict[str, set[str]]:
    """Return import name -> distributions for the required third-party imports of the packages."""
    names = {name for package in packages for name in imported(repository / package)}
    providers = distributions()
    outside = names - set(sys.stdlib_module_names) - {*PACKAGES, "live"} - optional(repository)
    return {name: {canonicalize_name(provider) for provider in providers[name]} for name in outside}


def requirements(repository: Path, extra: str | None = None) -> set[str]:
    metadata = project(repository)
    listed = metadata["optional-dependencies"][extra] if extra else metadata["dependencies"]
    return {canonicalize_name(Requirement(line).name) for line in listed}


def optional(repository: Path) -> set[str]:
    """Return the import names of the optional extras: robots on a network, films as .mp4, clusters, simulators."""
    names = set().union(*(requirements(repository, extra) for extra in ("unitree", "video", "cluster")))
    return {name.replace("-", "_") for name in names} | {"pydrake", "mujoco_warp", "warp"}


@pytest.fixture(scope="session")
def source(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the unpacked source distribution."""
    folder = tmp_path_factory.mktemp("source")
    with tarfile.open(build(repository, "sdist", tmp_path_factory.mktemp("sdist"))) as archive:
        archive.extractall(folder, filter="data")
    (unpacked,) = folder.iterdir()
    return unpacked


@pytest.fixture(scope="session")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Return the wheel, built from the source distribution, as by an installer without a wheel."""
    return zipfile.ZipFile(build(source, "wheel", tmp_path_factory.mktemp("wheel")))


@pytest.fixture(scope="session")
def empty_environment(wheel: zipfile.ZipFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an environment with the wheel and its dependencies, without the clone."""
    folder = tmp_path_factory.mktemp("empty")
    venv.create(folder, symlinks=os.name != "nt")
    packages = site_packages(folder)
    wheel.extractall(packages)
    # Packages come from the environment of the tests; its editable installations have no effect there.
    (packages / "dependencies.pth").write_text(str(Path(gymnasium.__file__).parents[1]), encoding="utf-8")
    return folder


def test_the_wheel_holds_quad_env_alone_with_the_robot_and_its_types(wheel: zipfile.ZipFile) -> None:
    top_level = {name.partition("/")[0] for name in wheel.namelist()}
    assert {name for name in top_level if not name.endswith(".dist-info")} == {"quad_env"}
    data = {name for name in wheel.namelist() if name.startswith("quad_env/") and not name.endswith(".py")}
    robot = "quad_env/robots/simple_quad/simple_quad"
    assert data == {"quad_env/__init__.pyi", "quad_env/py.typed", f"{robot}.xml", f"{robot}.urdf"}


def test_the_source_distribution_holds_what_a_clone_does(source: Path, repository: Path) -> None:
    command = ["git", "-c", f"safe.directory={repository}", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a clone")
    there = [name for name in listed.stdout.split() if (repository / name).exists()]
    left_out = {name.partition("/")[0] for name in there if not (source / name).exists()}
    assert left_out <= {".ci", ".gitattributes", ".github", ".pre-commit-config.yaml"}


def test_the_version_is_the_same_everywhere(wheel: zipfile.ZipFile, repository: Path) -> None:
    version = project(repository)["version"]
    (described,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    assert f"\nVersion: {version}\n" in wheel.read(described).decode()
    assert f"\nversion: {version}\n" in (repository / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version = {{{version}}}" in (repository / "docs" / "citing.md").read_text(encoding="utf-8")
    assert f"\n## {version} - 2" in (repository / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_wheel_works_in_an_environment_without_a_clone(
    empty_environment: Path, repository: Path, tmp_path: Path
) -> None:
    made = run(empty_environment, ["-c", MAKE], tmp_path)
    assert (made.returncode, made.stderr) == (0, "")
    assert made.stdout.startswith(f"{project(repository)['version']} ")
    assert all(said in made.stdout for said in ("site-packages", "SimpleQuad-v0", "It stands", "MuJoCo"))
    asked = run(empty_environment, ["-m", "quad_env", "record", "walk.mcap"], tmp_path)
    assert asked.returncode == 2
    assert "clone" in asked.stderr
    assert len(asked.stderr.splitlines()) == 1


def test_evaluation_needs_no_torch_and_importing_policies_no_simulator(tmp_path: Path) -> None:
    code = """
import runpy, sys
import policies
assert "mujoco" not in sys.modules
class NotInstalled:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "stable_baselines3", "tensorboard"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, NotInstalled())
runpy.run_module("evaluate", run_name="__main__", alter_sys=True)
"""
    words = "--policies trot residual --scenarios flat --episodes 1 --threads 1 --out results"
    command = [sys.executable, "-c", code, *words.split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("package", ["evaluate", "train"])
def test_launcher_is_the_package(repository: Path, package: str, capsys) -> None:
    command = [sys.executable, f"{package}.py", "--help"]
    launcher = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=True)
    with contextlib.suppress(SystemExit):
        importlib.import_module(f"{package}.__main__").main(["--help"])
    said = [text.split("[OPTIONS]")[0] for text in (launcher.stdout, capsys.readouterr().out)]
    assert said[0] == said[1]
    assert said[0].startswith(f"usage: python -m {package} ")


def test_import_contracts_hold(repository: Path) -> None:
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_import_is_a_declared_dependency_and_every_dependency_is_imported(repository: Path) -> None:
    environment, commands = requirements(repository), requirements(repository, "commands")
    base, extra = environment | commands | requirements(repository, "bench"), requirements(repository, "train")
    evaluation, training = (third_party(repository, packages) for packages in ((*EVALUATION, VIEW), ("train",)))
    assert [name for name, providing in evaluation.items() if not providing & base] == []
    declared = base | extra | requirements(repository, "onnx")
    assert [name for name, providing in training.items() if not providing & declared] == []
    used = set().union(*evaluation.values())
    assert base <= used
    assert environment | commands <= set().union(*third_party(repository, ("quad_env",)).values())
    assert extra <= used.union(INDIRECT, *training.values())
    assert optional(repository) <= {
        name for package in ("evaluate", "live", "quad_env") for name in imported(repository / package)
    }


def test_actions_are_pinned_by_commit_and_the_job_that_can_publish_runs_nothing_else(repository: Path) -> None:
    yaml = pytest.importorskip("yaml")
    publishers = []
    for file in sorted((repository / ".github/workflows").glob("*.yml")):
        for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values():
            used = [step["uses"] for step in job["steps"] if "uses" in step]
            assert used
            assert all(re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40}", each) for each in used), file
            if job.get("permissions", {}).get("id-token") == "write":
                publishers.append(job)
    (job,) = publishers
    assert [step["uses"].partition("@")[0] for step in job["steps"]] == [
        "actions/download-artifact",
        "pypa/gh-action-pypi-publish",
    ]


def test_a_release_is_built_by_packages_of_fixed_versions(repository: Path) -> None:
    lines = (repository / ".github/release-requirements.txt").read_text(encoding="utf-8").splitlines()
    pinned = [Requirement(line) for line in lines if not line.startswith("#")]
    assert all([each.operator for each in requirement.specifier] == ["=="] for requirement in pinned)
    versions = {canonicalize_name(each.name): str(each.specifier).removeprefix("==") for each in pinned}
    assert "build" in versions
    toml = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))
    for text in toml["build-system"]["requires"]:
        needed = Requirement(text)
        assert needed.specifier.contains(versions[canonicalize_name(needed.name)])
