"""What is shipped: the wheel holds quad_env alone, each package pulls in only what it may, every dependency is used."""

import ast
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

EVALUATION = ("quad_env", "policies", "evaluate")
PACKAGES = (*EVALUATION, "train")
VIEW = "live/view"  # what a clone shows with the base dependencies alone; other commands of live say what they lack
INDIRECT = {"tensorboard"}  # imported by torch.utils.tensorboard when a training run logs


def python(code: str, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Code run by a fresh interpreter whose working directory is not the clone."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def imported(package: Path) -> Iterator[str]:
    """Top-level names of everything that a package's modules import, wherever in them."""
    for module in package.rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                yield node.module.partition(".")[0]


def third_party(repository: Path, packages: tuple[str, ...]) -> dict[str, set[str]]:
    """Import name -> distributions that provide it, for what the packages import from outside and cannot do without."""
    names = {name for package in packages for name in imported(repository / package)}
    providers = packages_distributions()
    outside = names - set(sys.stdlib_module_names) - {*PACKAGES, "live"} - optional(repository)
    return {name: {canonicalize_name(provider) for provider in providers[name]} for name in outside}


def requirements(repository: Path, extra: str | None = None) -> set[str]:
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = project["optional-dependencies"][extra] if extra else project["dependencies"]
    return {canonicalize_name(Requirement(line).name) for line in listed}


def optional(repository: Path) -> set[str]:
    """Import names of the extras that evaluation can do without: films as .mp4, clusters."""
    return {name.replace("-", "_") for extra in ("video", "cluster") for name in requirements(repository, extra)}


@pytest.fixture(scope="session")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, cwd=repository, capture_output=True, check=True)
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


@pytest.fixture(scope="session")
def installed_wheel(wheel: zipfile.ZipFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("installed")
    wheel.extractall(folder)
    return folder


def test_wheel_holds_quad_env_alone(wheel: zipfile.ZipFile) -> None:
    top_level = {name.partition("/")[0] for name in wheel.namelist()}
    assert {name for name in top_level if not name.endswith(".dist-info")} == {"quad_env"}


def test_wheel_holds_the_robot_and_the_type_marker(wheel: zipfile.ZipFile) -> None:
    data = {name for name in wheel.namelist() if name.startswith("quad_env/") and not name.endswith(".py")}
    robot = "quad_env/robots/simple_quad/simple_quad"
    assert data == {"quad_env/py.typed", f"{robot}.xml", f"{robot}.urdf"}


def test_installed_wheel_works_without_the_clone(installed_wheel: Path, repository: Path, tmp_path: Path) -> None:
    code = """
import sys
wheel, repository = sys.argv[1:]
sys.path = [wheel, *(folder for folder in sys.path if folder != repository)]
import gymnasium
env = gymnasium.make("quad_env:SimpleQuad-v0")
observation, info = env.reset(seed=0)
assert env.observation_space.contains(env.step(env.action_space.sample())[0])
from quad_env.__main__ import main
assert main([]) == 0
assert main(["info"]) == 0
assert main(["record", "walk.mcap"]) == 2
assert main(["doctor", "--policy", "trot"]) == 2
assert main(["doctor"]) == 0
print(sys.modules["quad_env"].__file__)
"""
    run = python(code, str(installed_wheel), str(repository), cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "policies, view, film, record, ros: in a clone of the project" in run.stdout
    assert "error: record is in a clone of the project" in run.stderr
    assert "they need a clone of the project" in run.stdout
    assert Path(run.stdout.splitlines()[-1]).is_relative_to(installed_wheel)


@pytest.mark.parametrize("package", ["quad_env", "policies"])
def test_import_does_not_load_the_simulator(package: str, tmp_path: Path) -> None:
    run = python(f"import sys, {package}; print('mujoco' in sys.modules)", cwd=tmp_path)
    assert run.stdout.strip() == "False", run.stderr


@pytest.mark.parametrize("package", EVALUATION)
def test_no_module_loads_the_learner(package: str, tmp_path: Path) -> None:
    code = f"""
import importlib, pkgutil, sys, {package}
for module in pkgutil.iter_modules({package}.__path__):
    importlib.import_module("{package}." + module.name)
print(sorted(set(sys.modules) & {{"torch", "stable_baselines3", "tensorboard"}}))
"""
    run = python(code, cwd=tmp_path)
    assert run.stdout.strip() == "[]", run.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--policies", "trot", "residual", "--scenarios", "flat", "--episodes", "2", "--out", "results"),
    ],
    ids=["help", "run"],
)
def test_evaluation_needs_no_torch(arguments: tuple[str, ...], tmp_path: Path) -> None:
    code = """
import runpy, sys
class NotInstalled:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "stable_baselines3", "tensorboard"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, NotInstalled())
runpy.run_module("evaluate", run_name="__main__", alter_sys=True)
"""
    run = python(code, *arguments, cwd=tmp_path)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("module", ["evaluate", "train"])
def test_launcher_is_the_package(repository: Path, module: str) -> None:
    launcher, package = (
        subprocess.run([sys.executable, *how, "--help"], cwd=repository, capture_output=True, text=True, check=True)
        for how in ([f"{module}.py"], ["-m", module])
    )
    assert launcher.stdout == package.stdout


def test_import_contracts_hold(repository: Path) -> None:
    run = subprocess.run(["lint-imports", "--no-cache"], cwd=repository, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout


def test_every_import_of_evaluation_is_a_base_dependency(repository: Path) -> None:
    declared = requirements(repository)
    missing = {
        name for name, providers in third_party(repository, (*EVALUATION, VIEW)).items() if not providers & declared
    }
    assert not missing


def test_every_import_of_training_is_declared(repository: Path) -> None:
    declared = requirements(repository) | requirements(repository, "train") | requirements(repository, "sweep")
    missing = {name for name, providers in third_party(repository, ("train",)).items() if not providers & declared}
    assert not missing


def test_every_dependency_is_used(repository: Path) -> None:
    base = set().union(*third_party(repository, (*EVALUATION, VIEW)).values())
    training = set().union(*third_party(repository, PACKAGES).values()) | INDIRECT
    assert requirements(repository) <= base
    assert requirements(repository, "train") <= training
    assert optional(repository) <= set(imported(repository / "evaluate"))
