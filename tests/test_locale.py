"""All commands are independent of the locale: files are UTF-8, and an ASCII terminal shows `?` for other characters."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "COLUMNS": "100"}
PACKAGES = "quad_env", "policies", "evaluate", "train", "live", "research", "benchmarks", "examples", "docs"
TINY = (
    "--steps 64 --max-episode-steps 8 --threads 1 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat "
    "--ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 8 --ppo.critic 8"
)


def run(words: str, folder: Path, repository: Path) -> str:
    """Return the output of a command on a terminal of ASCII; the command must not fail."""
    command = [sys.executable, "-m", *words.format(folder).split()]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONIOENCODING"} | ASCII
    done = subprocess.run(command, cwd=repository, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return done.stdout.decode("ascii")


@pytest.mark.parametrize(
    "words",
    [
        "quad_env describe simple_quad --toml {}/mine.toml",
        f"train {TINY} --out {{}}/run",
    ],
)
def test_commands_work_where_text_is_ascii(words: str, tmp_path: Path, repository: Path) -> None:
    assert run(words, tmp_path, repository) or words.startswith("train")


def test_reports_are_the_same_where_text_is_ascii(tmp_path: Path, repository: Path) -> None:
    run("evaluate trot --scenarios flat --episodes 1 --threads 1 --out {}", tmp_path, repository)
    written = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "\xa0" in written
    printed = run("evaluate report {}", tmp_path, repository)
    assert "trot" in printed
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == written


def test_every_text_file_is_read_and_written_as_utf_8(repository: Path) -> None:
    """The linter's rule PLW1514 finds these calls only if it can infer the type of a path."""
    files = [path for package in PACKAGES for path in (repository / package).rglob("*.py")]
    assert len(files) > 300
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("read_text", "write_text"):
                assert any(keyword.arg == "encoding" for keyword in node.keywords), f"{path}:{node.lineno}"
