"""The command: user errors are one line and exit code 2 before the simulation; Ctrl-C keeps the finished episodes."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import policies
from evaluate.__main__ import main
from evaluate.records.store import FILES
from quad_env.files.writing import FolderInUseError, exclusive_lock
from tests.seams import full_disk, replace_report, replace_simulation

PYTHON = (sys.executable, "-W", "error")


@pytest.mark.usefixtures("no_simulation")
def test_a_folder_that_cannot_be_written_to_is_refused(refused, tmp_path) -> None:
    (tmp_path / "file").write_text("not a folder", encoding="utf-8")
    assert "--out" in refused(main, "trot", "--out", tmp_path / "file")
    (tmp_path / "report.html").mkdir()
    line = refused(main, "trot", "--out", tmp_path)
    assert str(tmp_path / "report.html") in line
    assert "--out" in line
    (tmp_path / "report.html").rmdir()
    (tmp_path / "parts").touch()
    assert "--out" in refused(main, "trot", "--out", tmp_path)


QUICK = ("--policies", "document", "--scenarios", "flat", "--episodes", "1")


@pytest.mark.parametrize("failing", ["results.json", "report.html"])
def test_a_disk_that_fills_up_loses_neither_table_nor_other_files(capsys, tmp_path, monkeypatch, failing) -> None:
    """The write of one file fails after the simulation; a single episode has no intervals."""

    full_disk(monkeypatch, failing)
    assert main([*QUICK, "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert "2.000" in printed.out
    line = printed.err.splitlines()[-1]
    assert line.startswith(f"error: cannot write {tmp_path / failing} ({os.strerror(errno.ENOSPC)})")
    assert line.endswith(f"python -m evaluate report {tmp_path}")
    assert {path.name for path in tmp_path.iterdir()} == {*FILES, "parts"} - {failing}
    monkeypatch.undo()
    assert main(["report", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {*FILES}
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["policies"]["document"]["scenarios"]
    assert (found["flat"]["velocity_error"], found["flat"]["velocity_error_ci"]) == (2.0, [None, None])


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys\nfrom evaluate.__main__ import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as end:\n    code = end.code\n"
        "heavy = {'scipy', 'matplotlib', 'pyarrow', 'mujoco', 'torch', 'gymnasium', 'pandas'} & set(sys.modules)\n"
        "print('loaded:', sorted(heavy), code)\n"
    )
    printed = subprocess.run([*PYTHON, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "loaded: [] 0" in printed
    for option in ("--policies", "--scenarios", "--episodes", "--seed", "--out", "--threads"):
        assert option in printed
    assert "default: 20" in printed


@pytest.mark.usefixtures("no_simulation")
def test_a_residual_that_is_not_shipped_is_said_to_be_missing(refused, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path / "models")
    assert "python -m train" in refused(main, "--out", tmp_path / "out")


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
def test_a_reader_that_leaves_early_loses_no_file(repository, tmp_path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [*PYTHON, "-m", "evaluate", *QUICK, "--out", str(tmp_path)]
    finished = subprocess.run(command, cwd=repository, stdout=writing, stderr=writing, check=False)
    os.close(writing)
    assert finished.returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {*FILES}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_written_is_one_line(repository, tmp_path) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        options = {"cwd": repository, "stdout": full, "stderr": subprocess.PIPE, "text": True, "check": False}
        run = subprocess.run([*PYTHON, "-m", "evaluate", *QUICK, "--out", str(tmp_path)], **options)
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert run.stderr.splitlines()[-1].startswith("error: cannot write the table")
    assert (tmp_path / "results.json").is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
def test_ctrl_c_keeps_what_was_done(repository, tmp_path, running) -> None:
    arguments = ("--policies", "document", "trot", "--scenarios", "flat", "--episodes", "512")
    command = [*PYTHON, "-m", "evaluate", *arguments, "--out", str(tmp_path)]
    with running(command, cwd=repository) as process:
        assert process.stderr.readline().startswith("[1/2] flat: document")
        time.sleep(0.5)  # during the next cell, which takes many seconds
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert "interrupted" in error.splitlines()[-1]
    assert error.splitlines()[-1].endswith(f"python -m evaluate --resume --out {tmp_path}")
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["complete"] is False
    assert list(results["policies"]) == ["document"]
    assert results["policies"]["document"]["scenarios"]["flat"]["episodes"] == 512
    assert "Interrupted" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert {path.name for path in tmp_path.iterdir()} == {*FILES, "parts"}


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
@pytest.mark.parametrize(
    ("words", "delay"),
    [
        ("evaluate trot --scenarios flat --episodes 512 --out {}", 0.3),
        ("evaluate trot --scenarios flat --episodes 512 --out {}", 1.2),
        ("quad_env view --no-browser --port 0", 0.2),
    ],
)
def test_ctrl_c_at_any_moment_ends_in_one_line(repository, tmp_path, words, delay, running) -> None:
    """Ctrl-C may appear as another error during the import of modules."""
    command = [*PYTHON, "-X", "importtime", "-m", *words.format(tmp_path).split()]
    with running(command, cwd=repository) as process:
        # Python itself is starting before that time.
        while not process.stderr.readline().endswith("quad_env.cli.command_line\n"):
            assert process.poll() is None
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=120)
    assert (process.returncode, output) == (130, "")
    said = [line for line in error.splitlines() if not line.startswith("import time:")]
    assert len(said) == 1
    assert said[0].startswith("interrupted: ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders there")
@pytest.mark.usefixtures("no_simulation")
@pytest.mark.parametrize("arguments", [(), ("--resume",)], ids=" ".join)
def test_a_folder_that_another_run_writes_to_is_refused_at_once(refused, tmp_path, run, arguments) -> None:
    """The run's own folder is refused with and without --resume; before its first part, a folder has no manifest."""
    mine = ["--policies", "document", "stand", "trot", "--scenarios", "flat", "push", "--episodes", "5", "--seed", "3"]
    for folder in (run.folder, tmp_path):
        before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
        with exclusive_lock(folder):
            assert f"{folder} is being written to" in refused(main, *mine, *arguments, "--out", folder)
        assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders there")
def test_the_folder_is_the_runs_own_until_everything_is_written(capsys, tmp_path, monkeypatch) -> None:
    held = []

    def looked(*_args, **_options):
        try:
            with exclusive_lock(tmp_path):
                held.append(False)
        except FolderInUseError:
            held.append(True)
        raise KeyboardInterrupt

    replace_simulation(monkeypatch, looked)
    assert main(["--policies", "trot", "--threads", "1", "--out", str(tmp_path)]) == 130
    assert held == [True]
    monkeypatch.undo()
    replace_report(monkeypatch, looked)
    assert main([*QUICK, "--out", str(tmp_path)]) == 130
    assert held == [True, True]
    capsys.readouterr()


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders there")
def test_a_report_of_a_folder_that_is_written_to_prints_and_leaves_the_files_alone(capsys, run) -> None:
    before = {path: path.stat().st_mtime_ns for path in run.folder.iterdir()}
    with exclusive_lock(run.folder):
        assert main(["report", str(run.folder)]) == 0
    printed = capsys.readouterr()
    assert "trot" in printed.out
    assert printed.err.count("\n") == 1
    assert "writes the files itself" in printed.err
    assert {path: path.stat().st_mtime_ns for path in run.folder.iterdir()} == before


def test_a_report_by_another_rule_of_success_is_printed_and_leaves_the_files_alone(capsys, run, refused) -> None:
    before = {path: path.stat().st_mtime_ns for path in run.folder.iterdir()}
    assert main(["report", str(run.folder), "--success", "survival"]) == 0
    said = capsys.readouterr().out
    assert "success by survival: upright to the end" in said
    fell = run.results["policies"]["stand"]["scenarios"]["flat"]["falls"]
    assert (fell, run.results["policies"]["stand"]["scenarios"]["flat"]["successes"]) == (0, 0)
    on_flat = said[said.index("\nflat") :]
    assert next(line for line in on_flat.splitlines() if line.startswith(" stand")).split()[1:3] == ["100", "%"]
    assert "'isaac-lab'" in refused(main, "report", run.folder, "--success", "luck")
    assert {path: path.stat().st_mtime_ns for path in run.folder.iterdir()} == before
