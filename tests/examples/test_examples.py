"""Every example as a user runs it, with few steps; what it says of itself; the command that runs them one by one."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import examples.__main__ as command
from examples.__main__ import EXAMPLES, FOLDER, Example, chosen, main
from quad_env.cli.command_line import UsageError

FILES = {
    path.stem: path
    for path in (*FOLDER.glob("*.py"), *(FOLDER / command.CLIENTS).glob("*.py"))
    if not path.stem.startswith("__")
}
SHORT = sorted(set(FILES) - {"residual_ppo"})  # which is a whole learner, with tests of its own
PRINTS = {
    "own_policy": r"ShortTrot.* trot +100\s%.* stand +0\s%.*episodes\.parquet",
    "read_parquet": r"stand +flat +0% of 2, 0\.\d+ m/s off",
    "combined_scenario": r"flat: 0\.\d\d m/s of 0\.50 m/s, 0 of 4 fell\s+hillside: 0\.\d\d m/s",
    "record_video": r"trot-episode-0\.mp4: 0\.\d\d m/s forward",
    "sb3_home_pose": r"saved .*sb3_home_pose\.zip after 1024 steps.* stand +0\s%.*report\.html",
    "sb3_batch": r"saved .*sb3_batch\.zip after 1024 steps",
    "rsl_rl_batch": r"saved .*policy\.onnx after 1152 steps",
    "cleanrl_loop": r"2,048 steps  reward -?0\.\d+ a step",
    "sb3_contrib_learners": r"TQC: 300 steps, 3 episodes earned.*CrossQ: 300 steps.*RecurrentPPO: 384 steps",
    "gymnasium_wrappers": r"async: (\S+)\n.*, sync: \1\n.*, vector_entry_point: \1\n",
    "minari_dataset": r"300 steps in 3 episodes on payload=5\+slope=8, \d fell; made again",
    "torchrl_collector": r"torch\.Size\(\[8\]\): .*256 frames.*256 frames",
    "rllib_ppo": r"512\.0 steps.*on SimpleQuadVectorEnv",
}
"""What is printed in the end, or a part of it."""


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("examples")


@pytest.mark.parametrize("name", PRINTS)
def test_it_runs_as_its_first_lines_say_and_prints_what_came(
    name: str, where: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    if missing := EXAMPLES[name].missing():
        pytest.skip(f"needs {', '.join(missing)}, of the extra clients: python -m examples {name} runs it")
    run = EXAMPLES[name].run(name, where)
    assert run.returncode == 0, run.stderr
    assert re.search(PRINTS[name], run.stdout, re.DOTALL), run.stdout
    assert "Warning" not in run.stderr or EXAMPLES[name].folder == command.CLIENTS, run.stderr


def test_every_file_is_run_and_listed() -> None:
    assert set(FILES) == set(EXAMPLES) == {*PRINTS, "residual_ppo"}
    rows = re.findall(
        r"^\| \[(?:clients/)?(\w+)\.py\]\(([^)]+)\) \|",
        (FOLDER / "README.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert {name: FOLDER / link for name, link in rows} == FILES


@pytest.mark.parametrize("name", SHORT)
def test_it_is_short_and_begins_with_what_it_shows_and_how_it_is_run(name: str) -> None:
    text = FILES[name].read_text(encoding="utf-8")
    said = ast.get_docstring(ast.parse(text)) or ""
    assert f"python {FILES[name].relative_to(FOLDER.parent).as_posix()}" in said
    assert len([line for line in said.splitlines() if line]) <= 3
    code = text.split('"""', 2)[2]
    lines = [line for line in code.splitlines() if line.strip() and not re.match(r'from |import |"""|#', line.strip())]
    assert 10 <= len(lines) <= 40


def test_only_those_that_are_named_run_and_the_one_before_whose_files_they_read() -> None:
    assert chosen(["cleanrl_loop", "own_policy"]) == ["own_policy", "cleanrl_loop"]
    assert chosen(["read_parquet"]) == ["own_policy", "read_parquet"]
    assert chosen([]) == list(EXAMPLES)
    with pytest.raises(UsageError, match="no example 'rlib'; there are own_policy, "):
        chosen(["rlib"])


def test_one_that_fails_or_lacks_a_package_is_named_and_the_others_run(monkeypatch, capsys, tmp_path) -> None:
    for name, code in (("good", "print(1)"), ("bad", "raise ValueError('of mine')"), ("poor", "")):
        (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
    listed = {"bad": Example("a"), "poor": Example("b", ("no-such-package", "numpy")), "good": Example("c", ("numpy",))}
    monkeypatch.setattr(command, "FOLDER", tmp_path)
    monkeypatch.setattr(command, "EXAMPLES", listed)
    monkeypatch.setenv("COLUMNS", "200")
    assert main([]) == 1
    said = capsys.readouterr().out
    assert "\n  ValueError: of mine\n" in said
    assert "good: ok (0 s)\n  1\n" in said
    assert said.count('".[clients]"') == 2  # in its line, and in the table
    assert re.findall(r"^(\w+): (.+) \(\d+ s\)$", said, re.MULTILINE) == [
        ("bad", "failed, exit code 1"),
        ("poor", 'needs no-such-package: pip install -e ".[clients]"'),
        ("good", "ok"),
    ]
    assert main(["good"]) == 0


def test_one_that_does_not_end_is_ended(monkeypatch, capsys, tmp_path) -> None:
    (tmp_path / "slow.py").write_text("import time; time.sleep(60)", encoding="utf-8")
    monkeypatch.setattr(command, "FOLDER", tmp_path)
    monkeypatch.setattr(command, "EXAMPLES", {"slow": Example("a")})
    monkeypatch.setattr(command, "LONGEST", 0.5)
    assert main([]) == 1
    assert "still running after 0.5 s" in capsys.readouterr().out


def test_a_wrong_name_gives_one_line_and_exit_code_2() -> None:
    run = subprocess.run([sys.executable, "-m", "examples", "rlib"], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1
    assert run.stdout == ""
