"""The README runs: Python blocks as they stand, commands by their modules and options, tables by the code."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import policies
from quad_env.scenarios.named import SCENARIOS
from quad_env.task.observations import TERMS

README = (Path(__file__).parents[1] / "README.md").read_text()
COMMANDS = [
    command
    for block in re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
    for command in line.split(" && ")
]
MODULE_COMMANDS = [command for command in COMMANDS if command.startswith("python -m ")]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def table(header: str) -> list[list[str]]:
    """Cells of the table under that header line, back quotes taken off, shape (rows, columns)."""
    lines = README.split(f"{header}\n", 1)[1].split("\n\n")[0].splitlines()[1:]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.parametrize("block", blocks("python"), ids=lambda block: block.strip().splitlines()[-1][:40])
def test_python_block_runs_as_it_stands(block: str, tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


@pytest.fixture(scope="module")
def help_texts() -> dict[str, str]:
    """Module -> its help."""
    modules = {shlex.split(command)[2] for command in MODULE_COMMANDS}
    helps = {}
    for module in modules:
        run = subprocess.run([sys.executable, "-m", module, "--help"], capture_output=True, text=True, check=True)
        helps[module] = run.stdout
    return helps


@pytest.mark.parametrize("command", MODULE_COMMANDS)
def test_command_names_a_module_and_options_that_exist(command: str, help_texts: dict[str, str]) -> None:
    _, _, module, *arguments = shlex.split(command)
    options = {argument for argument in arguments if argument.startswith("--")}
    assert options <= set(re.findall(r"--[\w.-]+", help_texts[module]))


@pytest.mark.parametrize("command", [command for command in COMMANDS if "--policies" in command])
def test_compared_policies_exist(command: str) -> None:
    listed = re.search(r"--policies ([^-]+)", command)
    assert listed is not None
    assert {name for name in listed[1].split() if "/" not in name} <= set(policies.names())


def test_set_up_is_two_commands_that_each_stand_alone(repository: Path) -> None:
    extras = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    environment = "python3 -m venv .venv && . .venv/bin/activate && pip install -e"
    first, second = (block.strip() for block in blocks("bash")[:2])
    assert first == f"{environment} . && python -m evaluate"
    assert second == f'{environment} ".[train,dev]" && pytest'
    assert set(extras) == {"train", "dev", "video"}


def test_observation_table_is_the_observation() -> None:
    assert table("| term | width | unit |") == [[term.name, str(term.width), term.unit] for term in TERMS]


def test_every_policy_has_its_row() -> None:
    assert sorted(row[0] for row in table("| name | what it is |")) == sorted(policies.names())


def test_every_scenario_is_named() -> None:
    (line,) = (line for line in README.splitlines() if line.startswith("| scenarios |"))
    assert {name for name in SCENARIOS if f"`{name}`" in line} == set(SCENARIOS)


def test_linked_files_and_listed_folders_exist(repository: Path) -> None:
    links = [target for target in re.findall(r"\]\(([^)]+)\)", README) if "://" not in target]
    folders = re.findall(r"^\| `(\w+/)` \|", README, re.MULTILINE)
    assert len(folders) >= 7
    assert [target for target in links + folders if not (repository / target).exists()] == []
