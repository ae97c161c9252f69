"""Files of the user's that have the name of a package of ours: said in one line, and never run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

THEIRS = "from pathlib import Path\nPath('ran').write_text('', encoding='utf-8')\n"


def run(words: str, folder: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *flags, "-m", *words.split()]
    # Without the tests' own ways to ours: `python -m` begins with the working folder.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


HIDING = {
    "evaluate --help": ("policies.py", "policies/__init__.py", "quad_env.py"),
    "train --help": ("evaluate.py",),
    "quad_env view --help": ("live.py",),
}


@pytest.mark.parametrize("words", HIDING)
def test_a_users_file_in_place_of_a_package_is_one_line_and_is_not_run(words: str, tmp_path: Path) -> None:
    program = words.split()[0]
    for number, theirs in enumerate(HIDING[words]):
        file = tmp_path / str(number) / theirs
        file.parent.mkdir(parents=True)
        file.write_text(THEIRS, encoding="utf-8")
        done = run(words, tmp_path / str(number))
        (line,) = done.stderr.splitlines()
        named = file.parent if file.name == "__init__.py" else file
        assert line.startswith("error: ")
        assert str(named) in line
        assert f"`python -P -m {program}`" in line
        assert (done.returncode, done.stdout) == (2, "")
    safe = run(words, tmp_path / "0", "-P")
    assert (safe.returncode, safe.stderr) == (0, "")
    assert not [*tmp_path.rglob("ran")]


def test_files_with_names_that_a_command_does_not_need_are_no_matter(tmp_path: Path) -> None:
    for name in ("train.py", "live.py", "examples.py"):
        (tmp_path / name).write_text(THEIRS, encoding="utf-8")
    (tmp_path / "policies").mkdir()  # a folder of bundles, not a package
    done = run("evaluate --help", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()


def test_python_p_evaluates_next_to_a_users_programs(tmp_path: Path) -> None:
    """Also in the processes that the command starts."""
    for name in ("train.py", "policies.py", "evaluate.py", "live.py"):
        (tmp_path / name).write_text(THEIRS, encoding="utf-8")
    done = run("evaluate stand --scenarios flat --episodes 2 --threads 2 --out out", tmp_path, "-P")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "report.html").is_file()
    assert not (tmp_path / "ran").exists()
