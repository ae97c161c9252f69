"""A robot is a value that is passed as an argument: its numbers and names are only in `quad_env.robots`.

No other module repeats its names or numbers. The default robot, SIMPLE_QUAD, is used as a default and in few other
places.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from quad_env.robots.simple_quad import SIMPLE_QUAD

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGES = ("quad_env", "policies", "evaluate", "train")
OF_SIMPLE_QUAD = {
    "quad_env/actuation/hardware.py": "its article has its motors",
    "quad_env/scenarios/axes.py": "severities are chosen for it",
    "quad_env/scenarios/registry.py": "and so are the named scenarios",
    "quad_env/scenarios/scenario.py": "which are not scaled for itself",
    "quad_env/serialisation.py": "old results know no other robot",
    "quad_env/task/observations.py": "public names are of it",
    "policies/description.py": "old bundles know no other robot",
    "policies/shipped.py": "what was trained for it has no folder of its own",
    "train/search/trot.py": "its parameters stand beside the code",
}
"""Modules that use SIMPLE_QUAD other than as the default of a parameter or of a field -> the reason."""
OF_OTHER_PROJECTS = "policies/external/readers/"
"""Folder with the leg names of other projects."""
WITHOUT_NUMBERS = ("quad_env/", "evaluate/measures/", "evaluate/records/", "evaluate/rollouts/")
LEG = re.compile(r"(?<![a-zA-Z0-9])(fl|fr|hl|hr)(?![a-zA-Z0-9])", re.IGNORECASE)


def modules(folder: str) -> Iterator[tuple[str, ast.Module]]:
    """Yield names and trees of the modules in a folder, without those of robots."""
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        name = path.relative_to(REPOSITORY).as_posix()
        if not name.startswith("quad_env/robots/"):
            yield name, ast.parse(path.read_text(encoding="utf-8"))


def chosen(tree: ast.Module) -> int:
    """Return the number of uses of SIMPLE_QUAD other than as the default of a parameter or of a field."""
    signatures = [node for node in ast.walk(tree) if isinstance(node, ast.arguments)]
    defaults = {id(default) for signature in signatures for default in (*signature.defaults, *signature.kw_defaults)}
    defaults |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.AnnAssign)}
    named = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "SIMPLE_QUAD"]
    return sum(id(node) not in defaults for node in named)


def texts(tree: ast.Module) -> Iterator[str]:
    """Return every text except docstrings."""
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.value


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_has_constants_of_a_robot_or_writes_the_name_of_a_leg_or_the_number_of_joints(package: str) -> None:
    for name, tree in modules(package):
        assert not chosen(tree) or name in OF_SIMPLE_QUAD, f"{name} names SIMPLE_QUAD: take a Robot instead"
        legs = [text for text in texts(tree) if LEG.search(text) and not name.startswith(OF_OTHER_PROJECTS)]
        assert not legs, f"{name} names legs: {legs}; take them from a Robot's leg_names"
        if name.startswith(WITHOUT_NUMBERS):
            numbers = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
            assert not any(type(number) is int and number == SIMPLE_QUAD.num_joints for number in numbers), name
