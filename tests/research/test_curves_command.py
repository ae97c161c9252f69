"""`python -m research curves`: figures of runs, and one line for a folder without a run."""

from pathlib import Path

import pytest

from research.__main__ import main
from tests.research.test_curves import folder_of_run


def test_the_picture_is_written_and_each_curve_ends_on_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [folder_of_run(tmp_path / str(seed), [(1000, 0.5 + 0.1 * seed, 2.0)], seed=seed) for seed in range(2)]
    runs += [
        folder_of_run(tmp_path / "new", None, base="mpc"),
        folder_of_run(tmp_path / "old", [(7, 1.0, None)], base="trot"),
    ]
    out = tmp_path / "pictures" / "curves.svg"
    assert main(["curves", *map(str, runs), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.err == f"{tmp_path / 'new'} has no validation yet: left out\n"
    assert said.out.splitlines() == [
        "base trot_reference (2 seeds): success 55%, cost of transport 2.00 after 1,000 steps",
        "base trot (seed 0): success 100%, cost of transport – after 7 steps",
        str(out),
    ]
    assert b"cost of transport" in out.read_bytes()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("new --out FOLDER/a.svg", "no run with a validation to draw"),
        ("none --out FOLDER/a.svg", "no run in FOLDER/none: config.json cannot be read (No such file or directory)"),
        ("empty --out FOLDER/a.svg", "no run in FOLDER/empty: config.json cannot be read"),
        ("run --out FOLDER/a.bmp", "--out must end in .svg, .png, .pdf"),
        ("run --out FOLDER/file/a.svg", "--out: cannot write to the folder FOLDER/file"),
        ("run --out FOLDER/folder.svg", "folder.svg is a folder; name a file"),
        ("run run --out FOLDER/a.svg", "both seed 0"),
    ],
)
def test_bad_input_is_one_line(words: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder_of_run(tmp_path / "run", [(1000, 0.5, 2.0)])
    folder_of_run(tmp_path / "new", None)
    for name in ("empty", "folder.svg"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").touch()
    runs, _, out = words.partition(" --out ")
    given = [str(tmp_path / name) for name in runs.split()]
    assert main(["curves", *given, "--out", out.replace("FOLDER", str(tmp_path))]) == 2
    assert complaint.replace("FOLDER", str(tmp_path)) in capsys.readouterr().err.splitlines()[-1]
