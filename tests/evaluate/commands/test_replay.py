"""Any row of a results folder can be simulated again; differences are reported with the reason."""

import re

import numpy as np
import pyarrow.parquet as pq
import pytest

import policies
from evaluate.__main__ import main
from evaluate.records import manifest
from tests.evaluate.altered import other, with_value
from tests.seams import short_episodes


def replay(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    code = main(["replay", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


def test_a_row_is_found_by_its_place_in_the_file(run, capsys) -> None:
    rows = pq.read_table(run.folder / "episodes.parquet").to_pylist()
    for number in (13, len(rows) - 1):
        row = rows[number]
        code, said = replay(capsys, run.folder, number)
        assert code == 0
        first, *story = said.splitlines()
        assert first == (
            f"episode {row['episode']} of {row['policy']} on {row['scenario']}, seed {row['seed']}: "
            "identical to the bit"
        )
        assert 1 <= len(story) <= 5
        assert row["outcome"].replace("_", " ") in story[-1]
        if row["cause"] is not None:
            assert f"cause: {row['cause'].replace('_', ' ')}" in story[-1]


def test_a_value_that_differs_in_its_last_bit_is_named(run, tmp_path, capsys) -> None:
    """The sign of zero is compared as well: in row 0 the document's controller falls before energy counts."""
    stored = pq.read_table(run.folder / "episodes.parquet").column("energy").to_pylist()
    for row, wrong in ((10, float(np.nextafter(stored[10], np.inf))), (0, -0.0)):
        code, said = replay(capsys, other(run, tmp_path / str(row), with_value("energy", row, wrong)), row)
        assert code == 1
        assert f"energy: {wrong} then, {stored[row]} now" in said
        assert said.count(" then, ") == 1
        assert "leaves no trace" in said


def test_what_may_have_caused_a_difference_is_said(run, tmp_path, capsys, monkeypatch) -> None:
    changed = other(run, tmp_path / "other", with_value("energy", 10, 1.0))
    now = manifest.versions() | {"mujoco": "9.9"}
    monkeypatch.setattr(manifest, "versions", lambda: now)
    monkeypatch.setattr(manifest, "cpu_model", lambda: "an abacus")
    monkeypatch.setattr(manifest, "policy_digest", lambda _: "f" * 64)
    code, said = replay(capsys, run.folder, 10)
    assert (code, "because" in said) == (0, False)
    code, said = replay(capsys, changed, 10)
    assert code == 1
    for words in ("mujoco was ", "and is 9.9", "an abacus", "the policy trot has changed"):
        assert words in said


@pytest.mark.usefixtures("no_page")
def test_an_episode_is_run_again_with_its_hardware(tmp_path, capsys, monkeypatch) -> None:
    option, usual, other, column = "sensors", "truth", "typical", "velocity_error"
    short_episodes(monkeypatch, 150)
    figures = []
    for name in (usual, other):
        words = f"--policies residual --scenarios flat --episodes 2 --{option} {name} --out {tmp_path / name}"
        assert main(words.split()) == 0
        assert replay(capsys, tmp_path / name, 1)[0] == 0
        figures.append(pq.read_table(tmp_path / name / "episodes.parquet").column(column)[1].as_py())
    assert figures[0] != figures[1]
    then, now = (manifest.read(tmp_path / name) for name in (usual, other))
    assert manifest.differences(then, now) == [f"{option} was {usual} and is {other}"]
    assert then.fingerprint != now.fingerprint


def test_a_policy_that_is_gone_is_a_mistake(run, refused, monkeypatch) -> None:
    monkeypatch.setattr(policies.registry, "MAKERS", {"trot": policies.Trot})
    assert "'document'" in refused(main, "replay", run.folder, 0)


def test_failed_episodes_are_listed_with_the_row_that_replays_them(run, capsys) -> None:
    rows = pq.read_table(run.folder / "episodes.parquet").to_pylist()
    failed = [row for row, each in enumerate(rows) if each["outcome"] != "succeeded"]
    assert main(["replay", str(run.folder), "--failed"]) == 0
    heads, *lines, last = capsys.readouterr().out.splitlines()
    assert heads.split()[:4] == ["row", "policy", "scenario", "episode"]
    assert [int(line.split()[0]) for line in lines] == failed
    for line, each in zip(lines, (rows[row] for row in failed), strict=True):
        assert line.split()[1:4] == [each["policy"], each["scenario"], str(each["episode"])]
        assert each["outcome"].replace("_", " ") in line
        assert (each["cause"] or "–").replace("_", " ") in line
    assert last.startswith(f"{len(failed)} failed episodes; see one: python -m evaluate replay ")
    assert f" {failed[0]} --page {failed[0]}.html" in last
    assert main(["replay", str(run.folder), "--failed", "--policy", "document", "--scenario", "push"]) == 0
    _, *lines, last = capsys.readouterr().out.splitlines()
    own = [row for row in failed if (rows[row]["policy"], rows[row]["scenario"]) == ("document", "push")]
    assert [int(line.split()[0]) for line in lines] == own
    assert main(["replay", str(run.folder), "--failed", "--policy", "trot", "--scenario", "flat"]) == 0
    assert "0 failed episodes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "EPISODE: no row given; `python -m evaluate replay "),
        (["3", "--failed"], "--failed lists episodes: leave out EPISODE"),
        (["--failed", "--page", "x.html"], "--failed lists episodes: leave out EPISODE"),
        (["--failed", "--policy", "trott"], "--policy: no trott among"),
    ],
)
def test_what_is_to_be_listed_or_replayed_is_asked_for_in_one_line(run, refused, words, said) -> None:
    assert said in refused(main, "replay", str(run.folder), *words)


def test_the_end_of_a_run_names_a_row_that_failed(run, capsys, no_page) -> None:
    assert main(["report", str(run.folder)]) == 0
    said = capsys.readouterr().out
    (row,) = re.findall(r"fails in row (\d+): python -m evaluate replay \S+ \1 --page \1\.html; all failures: ", said)
    rows = pq.read_table(run.folder / "episodes.parquet").to_pylist()
    assert rows[int(row)]["outcome"] != "succeeded"
