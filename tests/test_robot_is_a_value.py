"""A robot is a value that is handed down: its figures and names stand in `quad_env.robots` alone.

Nobody imports a robot's constants, nobody writes its names a second time, and the one robot that there is, SIMPLE_QUAD,
is named only where a default is chosen.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from quad_env.robots.simple_quad import SIMPLE_QUAD

REPOSITORY = Path(__file__).resolve().parents[1]
ROOMS = (
    "quad_env",
    "evaluate/analysis",
    "evaluate/measures",
    "evaluate/records",
    "evaluate/report",
    "evaluate/rollouts",
    "policies",
    "train",
)
"""Folders and modules where it holds."""
DEFAULT_CHOSEN = {
    "quad_env/__init__.py",
    "quad_env/envs/env.py",
    "quad_env/envs/vector_env.py",
    "quad_env/scenarios/axes.py",
    "quad_env/serialisation.py",
    "quad_env/task/observations.py",
    "evaluate/rollouts/hardware.py",
    "policies/__init__.py",
    "policies/article/printed.py",
    "policies/article/repaired.py",
    "policies/base.py",
    "policies/behaviour/machine.py",
    "policies/behaviour/policy.py",
    "policies/bundle.py",
    "policies/gaits/policy.py",
    "policies/safety/watchdog.py",
    "policies/trot/feedback.py",
    "policies/trot/open_loop.py",
    "train/search/recovery.py",
}
"""Modules that may name SIMPLE_QUAD: defaults and public names, severities and parameters that are chosen for it, and
old results and bundles, which know no other robot."""
LEG = re.compile(r"(?<![a-zA-Z0-9])(fl|fr|hl|hr)(?![a-zA-Z0-9])", re.IGNORECASE)


def modules(room: str) -> list[Path]:
    path = REPOSITORY / room
    found = [path] if path.is_file() else sorted(path.rglob("*.py"))
    return [each for each in found if "robots" not in each.relative_to(REPOSITORY).parts]


def imported(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Module and name of everything that is imported from somewhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)


def texts(tree: ast.Module) -> Iterator[str]:
    """Every text that is no docstring."""
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.value


@pytest.mark.parametrize("room", ROOMS)
def test_no_module_imports_constants_of_a_robot(room: str) -> None:
    for path in modules(room):
        tree, name = ast.parse(path.read_text()), path.relative_to(REPOSITORY).as_posix()
        robots = [entry for entry in imported(tree) if entry[0].startswith("quad_env.robots")]
        constants = [found for module, found in robots if module == "quad_env.robots.robot" and found != "Robot"]
        assert not constants, f"{name} imports {constants}: take a Robot instead"
        default = [found for _, found in robots if found == "SIMPLE_QUAD"]
        assert not default or name in DEFAULT_CHOSEN, f"{name} names SIMPLE_QUAD: take a Robot instead"


@pytest.mark.parametrize("room", ROOMS)
def test_no_module_writes_the_name_of_a_leg(room: str) -> None:
    for path in modules(room):
        named = [text for text in texts(ast.parse(path.read_text())) if LEG.search(text)]
        assert not named, f"{path.relative_to(REPOSITORY)} names legs: {named}; take them from a Robot's leg_names"


@pytest.mark.parametrize("room", ["quad_env", "evaluate/measures", "evaluate/records", "evaluate/rollouts"])
def test_no_module_writes_how_many_joints_a_robot_has(room: str) -> None:
    for path in modules(room):
        numbers = [node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)]
        assert not any(type(number) is int and number == SIMPLE_QUAD.num_joints for number in numbers), path


def test_what_is_looked_for_would_be_found() -> None:
    planted = ast.parse('"""fl_foot"""\nfrom quad_env.robots.robot import HOME_POSE\nx = f"fl_{link}"\ny = "1fr", "FL"')
    assert list(imported(planted)) == [("quad_env.robots.robot", "HOME_POSE")]
    assert [text for text in texts(planted) if LEG.search(text)] == ["fl_", "FL"]
