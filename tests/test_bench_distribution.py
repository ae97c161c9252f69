"""`simple-quad` needs few packages, and `simple-quad-bench` brings policies and evaluator to other people's projects.

Both wheels are unpacked into empty virtual environments, to which exactly the distributions are linked that their
metadata asks for; these come from the environment of the tests, so that nothing is fetched.
"""

import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from email.parser import HeaderParser
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement

from evaluate.records.provenance import code_digest
from tests.distributions import build, description, install, needed, python_of, run, site_packages

MAX_PACKAGES = 12
"""Distributions that `pip install simple-quad` may bring."""
PACKAGES = ("policies", "evaluate", "train", "live")
ENVIRONMENT = """
import gymnasium, quad_env
for name in quad_env.__all__:
    getattr(quad_env, name)
for scenario in ("flat", "rough", "push+hardware", "stairs+randomised"):
    env = gymnasium.make("SimpleQuad-v0", scenario=scenario)
    env.reset(seed=0)
    env.step(env.action_space.sample())
robots = gymnasium.make_vec("quad_env:SimpleQuad-v0", num_envs=2, sensors="typical", estimator="kalman")
robots.reset(seed=0)
robots.step(robots.action_space.sample())
"""
MY_POLICY = """
class Stand:
    def __call__(self, observation):
        return [0.0, 0.5, -1.0] * 4
"""
USE = """
import evaluate, policies, quad_env
from pathlib import Path
from policies.shipped import MODELS
place = Path(policies.__file__).parents[1]
assert {place, place / "simple_quad_bench"} == {Path(evaluate.__file__).parents[1], MODELS.parent}
import gymnasium
env = gymnasium.make("quad_env:SimpleQuad-v0")
observation, _ = env.reset(seed=0)
for name in ("residual", "robust", "mpc_wbc"):
    policy = policies.make(name)
    policy.reset()
    assert env.action_space.contains(policy.act(observation))
tables = evaluate.load("out")
print(sorted(set(tables.episodes["policy"].to_pylist())))
from evaluate.records.provenance import code_digest, versions
print(versions()["git_revision"])
print(code_digest())
"""


class Wheels(NamedTuple):
    """Paths of both wheels."""

    quad: Path
    bench: Path


@pytest.fixture(scope="module")
def wheels(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Wheels:
    folders = (repository, repository / "packaging" / "bench")
    return Wheels(*(build(folder, "wheel", tmp_path_factory.mktemp("wheel")) for folder in folders))


@pytest.fixture(scope="module")
def bench(wheels: Wheels, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an environment with both distributions, in the git repository of another project."""
    project = tmp_path_factory.mktemp("project")
    identity = ["-c", "user.name=A", "-c", "user.email=a@b"]
    subprocess.run(["git", "init", "--quiet"], cwd=project, check=True)
    subprocess.run(["git", *identity, "commit", "--quiet", "--allow-empty", "-m", "x"], cwd=project, check=True)
    install(project / "env", wheels, needed(wheels, ["simple-quad-bench"]))
    return project / "env"


def built_requirements(repository: Path, out: Path) -> list[str]:
    """Return the requirements of an editable wheel, by the function of the backend that installers ask first."""
    code = """
import sys
import backend
prepare = getattr(backend, "prepare_metadata_for_build_editable", None)
(prepare or backend.build_editable)(sys.argv[1])
"""
    path = str(repository / "packaging")
    variables = os.environ | {"PYTHONPATH": path}
    command = [sys.executable, "-c", code, str(out)]
    subprocess.run(command, cwd=repository, env=variables, capture_output=True, check=True)
    (result,) = out.iterdir()
    if result.suffix == ".whl":
        return description(result)["Requires-Dist"]
    message = HeaderParser().parsestr((result / "METADATA").read_text(encoding="utf-8"))
    return message.get_all("Requires-Dist", [])


@pytest.fixture
def mixed(bench: Path) -> Iterator[Path]:
    """Return the same environment after the installation of another distribution `evaluate`."""
    folder = site_packages(bench) / "evaluate-0.4.6.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: evaluate\nVersion: 0.4.6\n", encoding="utf-8")
    yield bench
    shutil.rmtree(folder)


def test_the_environment_alone_needs_few_packages(wheels: Wheels, tmp_path: Path) -> None:
    names = needed([wheels.quad], ["simple-quad"])
    assert len(names) <= MAX_PACKAGES
    install(tmp_path / "env", [wheels.quad], names)
    done = run(tmp_path / "env", ["-W", "error", "-c", ENVIRONMENT], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    for command, package in (("info", "tyro"), ("describe", "tyro"), ("doctor", "tyro")):
        asked = run(tmp_path / "env", ["-m", "quad_env", command], tmp_path)
        said = f'error: this needs {package}, which is not installed: pip install "simple-quad[commands]"\n'
        assert (asked.returncode, asked.stderr) == (2, said)


def test_the_extra_commands_is_all_that_the_commands_need(wheels: Wheels, tmp_path: Path) -> None:
    install(tmp_path / "env", [wheels.quad], needed([wheels.quad], ["simple-quad[commands]"]))
    for words in (["info"], ["describe", "simple_quad"], ["scenarios"], ["doctor"]):
        done = run(tmp_path / "env", ["-m", "quad_env", *words], tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
    asked = run(tmp_path / "env", ["-m", "quad_env", "view"], tmp_path)
    assert asked.returncode == 2
    assert "pip install simple-quad-bench" in asked.stderr
    assert len(asked.stderr.splitlines()) == 1


def test_the_wheel_holds_all_files_of_its_packages_and_the_models(wheels: Wheels, repository: Path) -> None:
    roots = {name: name for name in PACKAGES} | {"models": "simple_quad_bench/models"}
    expected = {
        f"{place}/{file.relative_to(repository / name).as_posix()}"
        for name, place in roots.items()
        for file in (repository / name).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    with zipfile.ZipFile(wheels.bench) as archive:
        names = set(archive.namelist())
    assert {name for name in names if ".dist-info/" not in name} == expected
    assert any(name.endswith("/LICENSE") for name in names)


def test_both_distributions_have_one_version_and_one_list_of_needs(wheels: Wheels) -> None:
    quad, bench = map(description, wheels)
    needs = [Requirement(line) for line in bench["Requires-Dist"]]
    required = [each for each in needs if each.marker is None]
    assert [each.extras for each in required] == [{"commands", "bench"}]
    for extra in bench["Provides-Extra"]:
        (requirement,) = (each for each in needs if each.marker is not None and each.marker.evaluate({"extra": extra}))
        assert requirement.extras == {extra}
    assert {extra for each in needs for extra in each.extras} <= set(quad["Provides-Extra"])
    assert {(each.name, str(each.specifier)) for each in needs} == {("simple-quad", f"=={quad['Version'][0]}")}
    for header in ("Version", "Requires-Python"):
        assert bench[header] == quad[header]


def test_an_editable_installation_needs_what_the_commands_of_the_readme_need(repository: Path, tmp_path: Path) -> None:
    lines = built_requirements(repository, tmp_path)
    needs = {requirement.name for requirement in map(Requirement, lines) if requirement.marker is None}
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    expected = [*project["dependencies"], *optional["commands"], *optional["bench"]]
    assert needs == {Requirement(line).name for line in expected}


def test_another_project_evaluates_with_both_distributions(bench: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MY_POLICY, encoding="utf-8")
    words = "-m evaluate --quick --policies stand mine.py:Stand --episodes 1 --threads 1 --out out"
    done = run(bench, words.split(), tmp_path)
    assert done.returncode == 0, done.stderr
    used = run(bench, ["-c", USE], tmp_path)
    assert (used.returncode, used.stderr) == (0, "")
    assert used.stdout.splitlines() == ["['mine.py:Stand', 'stand']", "None", code_digest()]
    for command in ("train", "quad_env"):
        assert run(bench, ["-m", command, "--help"], tmp_path).returncode == 0
    listed = run(bench, ["-m", "quad_env", "policies"], tmp_path)
    assert (listed.returncode, listed.stderr) == (0, "")
    assert "residual" in listed.stdout


def commit_all(folder: Path) -> str:
    """Put a folder into a new git repository, and return the commit."""
    git = ["git", "-C", str(folder), "-c", "user.name=A", "-c", "user.email=a@b"]
    for words in (["init", "--quiet"], ["add", "--all"], ["commit", "--quiet", "-m", "x"]):
        subprocess.run([*git, *words], check=True)
    return subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()


def test_a_git_url_of_the_second_installs_the_first_of_the_same_commit(
    wheels: Wheels, repository: Path, tmp_path: Path
) -> None:
    """pip takes all other packages, and the build backend, from the environment."""
    clone = tmp_path / "clone"
    for name in ("quad_env", "packaging", "models", *PACKAGES):
        shutil.copytree(repository / name, clone / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(repository / name, clone / name)
    commit = commit_all(clone)
    env = tmp_path / "env"
    install(env, [], needed(wheels, ["simple-quad-bench"]) | needed([], ["hatchling"]))
    url = f"git+{clone.as_uri()}#subdirectory=packaging/bench"
    options = ["--quiet", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", "--python", str(python_of(env)), "install", *options, url], check=True)
    for name in ("simple_quad", "simple_quad_bench"):
        (file,) = site_packages(env).glob(f"{name}-*.dist-info/direct_url.json")
        assert json.loads(file.read_text(encoding="utf-8"))["vcs_info"]["commit_id"] == commit
    done = run(env, ["-c", "import policies; print(policies.make('residual'))"], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_torch_is_needed_for_names_the_extra(bench: Path, tmp_path: Path) -> None:
    done = run(bench, ["-m", "train", "--steps", "1", "--out", "run"], tmp_path)
    assert done.returncode == 2
    assert 'pip install "simple-quad[train]"' in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_another_evaluate_in_the_same_folder_is_said_in_one_line(mixed: Path, tmp_path: Path) -> None:
    imported = run(mixed, ["-c", "import evaluate"], tmp_path)
    assert imported.returncode == 1
    last = imported.stderr.splitlines()[-1]
    assert last.startswith("ImportError: evaluate: ")
    assert "simple-quad-bench and evaluate 0.4.6 (Hugging Face)" in last
    commanded = run(mixed, ["-m", "evaluate", "--help"], tmp_path)
    assert commanded.returncode != 0
    assert last.removeprefix("ImportError: ") in commanded.stderr
    assert len(commanded.stderr.splitlines()) == 1


def test_another_evaluate_that_has_replaced_the_package_is_said_in_one_line(mixed: Path, tmp_path: Path) -> None:
    file = site_packages(mixed) / "evaluate" / "__init__.py"
    text = file.read_text(encoding="utf-8")
    file.write_text("", encoding="utf-8")
    try:
        commanded = run(mixed, ["-m", "evaluate", "--help"], tmp_path)
    finally:
        file.write_text(text, encoding="utf-8")
    assert (commanded.returncode, commanded.stdout) == (2, "")
    assert "error: evaluate: " in commanded.stderr
    assert len(commanded.stderr.splitlines()) == 1


def test_another_evaluate_in_another_folder_is_no_fault(bench: Path, tmp_path: Path) -> None:
    other = tmp_path / "evaluate-0.4.6.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: evaluate\nVersion: 0.4.6\n", encoding="utf-8")
    done = run(bench, ["-c", "import evaluate; print(evaluate.load)"], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_pinned_lines_name_both_distributions(repository: Path) -> None:
    text = (repository / "docs" / "citing.md").read_text(encoding="utf-8")
    version = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f'pip install "git+file:///path/to/the/clone@v{version}"\n' in text
    assert f'pip install "git+file:///path/to/the/clone@v{version}#subdirectory=packaging/bench"\n' in text
