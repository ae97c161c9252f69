"""A user's file with the name of a package of the project is never run by a command."""

import os
import subprocess
import sys
from pathlib import Path

THEIRS = "from pathlib import Path\nPath('ran').write_text('', encoding='utf-8')\n"


def run(words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    # The path of the tests is removed: `python -m` starts with the working folder.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    command = [sys.executable, "-m", *words.split()]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_command_imports_ours_next_to_a_users_programs_also_in_the_processes_that_it_starts(tmp_path: Path) -> None:
    for name in ("quad_env.py", "policies.py", "live.py", "train.py"):
        (tmp_path / name).write_text(THEIRS, encoding="utf-8")
    done = run("evaluate stand --scenarios flat --episodes 2 --threads 2 --out out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "report.html").is_file()
    (tmp_path / "quad_env.py").rename(tmp_path / "evaluate.py")
    done = run("quad_env policies", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()
