"""A path to a missing file is reported as a missing file by every argument that takes a name or a path."""

from pathlib import Path

import pytest

import policies
import quad_env
from evaluate.rollouts import battery
from quad_env.files.paths import ENDINGS, missing_file_message
from quad_env.robots.registry import get_robot


@pytest.mark.parametrize("ending", sorted(ENDINGS))
def test_a_text_with_the_ending_of_a_file_is_a_path(ending: str, tmp_path: Path) -> None:
    for name in (f"mine{ending}", f"a/mine{ending}", f"mine{ending.upper()}"):
        assert missing_file_message(name) == f"there is no file {name}"
    there = tmp_path / f"mine{ending}"
    there.write_bytes(b"")
    assert missing_file_message(str(there)) is None


@pytest.mark.parametrize(
    "path", ["x/y", "./x", "x/", "..\\x", "~/x", "models/nothing-of-that-name", "x\0/y", "a" * 5000 + "/b"]
)
def test_a_text_with_a_separator_is_a_path(path: str) -> None:
    assert missing_file_message(path) == f"there is no file or folder {path}"


@pytest.mark.parametrize(
    "name", ["trot", "push:3", "noise=0.2", "payload=1.5+slope=10", "go1", "safe:trot", "", "v0.1"]
)
def test_a_name_is_no_path(name: str) -> None:
    assert missing_file_message(name) is None


def test_a_class_in_a_file_is_looked_for_in_its_file(tmp_path: Path) -> None:
    assert missing_file_message("x/own.py:Mine") == "there is no file x/own.py"
    (tmp_path / "own.py").write_text("", encoding="utf-8")
    assert missing_file_message(f"{tmp_path / 'own.py'}:Mine") is None


def test_policies_robots_and_scenarios_call_a_missing_path_so() -> None:
    with pytest.raises(policies.PolicyError, match=r"^there is no file or folder models/nix$"):
        policies.resolve("models/nix")
    with pytest.raises(policies.PolicyError, match=r"^there is no file or folder models/nix$"):
        policies.resolve("safe:models/nix")
    with pytest.raises(ValueError, match=r"^there is no file or folder robots/nix$"):
        get_robot("robots/nix")
    with pytest.raises(ValueError, match=r"^there is no file hill.png$"):
        quad_env.scenario("hill.png")
    for name in ("hills/nix", "hills/nix+hardware", "hills/nix:3"):
        with pytest.raises(ValueError, match=r"^there is no file or folder hills/nix"):
            battery.resolve((name,))
