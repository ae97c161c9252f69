"""The command `leaderboard`: a page from a list, and one line for each error in the list."""

import contextlib
import csv
import hashlib
import io
import json
import urllib.request
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from evaluate.records.store import read_run
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.__main__ import main
from research.pages import leaderboard as command
from research.pages import policy_list
from research.pages.leaderboard_page import format_gains
from tests.seams import short_episodes

REVISION, PATH, CONTENT = "d5e6b475", "onnx/go1 policy.onnx", b"a network"
PUBLISHED = f"""
[[published]]
name = "theirs"
source = "https://github.com/someone/robots"
revision = "{REVISION}"
policy = "theirs.toml"
files = {{ "{PATH}" = "{hashlib.sha256(CONTENT).hexdigest()}" }}
"""
WORDS = ("leaderboard", "--scenarios", "flat", "rough", "--episodes", "2", "--threads", "1")
NAMED = {"theirs": "trot", "mine": "stand"}
URL = f"https://github.com/someone/robots/raw/{REVISION}/onnx/go1%20policy.onnx"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder and make it the working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def listed(folder: Path, published: str = PUBLISHED, robot: str = "simple_quad", ours: str = '"trot", "stand"') -> Path:
    path = folder / "quads.toml"
    path.write_text(f'robot = "{robot}"\nours = [{ours}]\n{published}', encoding="utf-8")
    return path


def written(folder: Path, name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "docs/results" / name).read_text(encoding="utf-8").splitlines()))


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the working folder of a small leaderboard of two of the project's controllers, with episodes of 2 s."""
    folder = tmp_path_factory.mktemp("board")
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        short_episodes(patch, 200)
        assert main([*WORDS, str(listed(folder, published="", ours='"stand", "trot"'))]) == 0
        yield folder


def test_a_list_of_our_controllers_becomes_a_page_and_its_data(board) -> None:
    text = (board / "docs/leaderboard_quads.md").read_text(encoding="utf-8")
    first, flat, rough = text.split("\n## ")[1:]
    assert first.startswith(
        "Success\n\n| policy | servo: N·m/rad; N·m·s/rad | flat | rough | mean | cost of transport, flat "
        "| step rate, 1/s, flat | flight, %, flat |"
    )
    rows = [line.split(" | ") for line in first.splitlines() if line.startswith(("| trot", "| stand"))]
    assert [(row[0], row[1]) for row in rows] == [("| trot", "300; 10"), ("| stand", "300; 10")], "the best first"
    assert [rough.count(f"\n| {name} |") for name in ("trot", "stand")] == [1, 1]
    of = {(row["scenario"], row["policy"]): row for row in written(board, "leaderboard_quads.csv")}
    assert rows[0][2:4] == [
        f"{100 * float(of[scenario, 'trot']['success_rate']):.0f} %" for scenario in ("flat", "rough")
    ]
    error = float(of["flat", "trot"]["velocity_error"])
    assert f"| trot | 100\u00a0% [34,\u00a0100] | 0\u00a0% [0,\u00a066] | {error:.3f} ±" in flat
    assert "minus `trot`" in flat, "the reference is the best of ours"
    for row in written(board, "leaderboard_quads_differences.csv"):
        assert (row["a"], row["b"]) == ("stand", "trot")
        shown = f"| {float(row['difference']):.3f} [" in {"flat": flat, "rough": rough}[row["scenario"]]
        assert shown == (row["metric"] == "velocity_error"), row
    assert f"quads.toml --scenarios flat rough --episodes 2`; MuJoCo {version('mujoco')}" in text
    run = json.loads((board / "results/leaderboard/quads/trot/results.json").read_text(encoding="utf-8"))
    assert error == pytest.approx(run["policies"]["trot"]["scenarios"]["flat"]["velocity_error"], rel=1e-5)


def test_a_finished_policy_is_not_run_again(board) -> None:
    before = {file: file.stat().st_mtime_ns for file in (board / "results").rglob("results.json")}
    assert main([*WORDS, "quads.toml", "--reference", "stand", "--out", "docs/other.md"]) == 0
    assert "minus `stand`" in (board / "docs/other.md").read_text(encoding="utf-8")
    assert {file: file.stat().st_mtime_ns for file in (board / "results").rglob("results.json")} == before


def test_policies_have_their_names_of_the_list_and_the_reference_is_the_best_of_ours(board) -> None:
    runs = {name: read_run(board / "results/leaderboard/quads" / label) for name, label in NAMED.items()}
    of_ours = command._results(runs, ("mine",), None)
    assert (of_ours.baseline, set(of_ours.policies)) == ("mine", {"mine", "theirs"})
    for ours, reference in ((("mine",), "theirs"), ((), None)):
        assert command._results(runs, ours, reference).baseline == "theirs"


def test_a_run_that_was_begun_otherwise_is_one_line(board, refused) -> None:
    said = refused(main, *WORDS, "quads.toml", "--episodes", "3")
    assert "stand: --resume" in said
    assert "--episodes was 2, not 3" in said
    assert "delete results/leaderboard/quads/stand" in said


def test_a_missing_file_is_named_with_its_address(folder, capsys) -> None:
    path = listed(folder)
    assert main(["leaderboard", str(path), "--files", "theirs"]) == 2
    missing, error = capsys.readouterr().err.splitlines()
    assert missing == f"theirs: download {URL} to theirs/someone/robots/{PATH}"
    assert error == f"error: 1 file of {path} not in theirs: get them, or give --fetch"


def test_a_file_of_another_hash_is_refused(folder, refused) -> None:
    place = folder / "theirs/someone/robots" / PATH
    place.parent.mkdir(parents=True)
    place.write_bytes(b"another network")
    said = refused(main, "leaderboard", listed(folder), "--files", "theirs")
    assert "is not the file of theirs: its SHA-256 is" in said
    assert f"download {URL} to it" in said


def answer(content: bytes, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Serve `content` at every address, and return the list of requested addresses."""
    asked: list[str] = []
    monkeypatch.setattr(urllib.request, "urlopen", lambda url, timeout: asked.append(url) or io.BytesIO(content))
    return asked


def test_fetch_keeps_what_has_the_lists_hash_and_puts_the_description_beside_it(folder, monkeypatch, refused) -> None:
    (folder / "theirs.toml").write_text('network = "go1 policy.onnx"', encoding="utf-8")
    path, place = listed(folder), folder / "files/someone/robots" / PATH
    asked = answer(b"another network", monkeypatch)
    assert f"{URL} is not the file of theirs" in refused(main, "leaderboard", path, "--files", "files", "--fetch")
    assert not place.exists(), "nothing is kept that is not the list's"
    asked += answer(CONTENT, monkeypatch)
    for _ in range(2):
        found = policy_list.resolve_references(policy_list.read_list(path), path, folder / "files", fetch=True)
        assert found == {"trot": "trot", "stand": "stand", "theirs": str(place.parent / "theirs.toml")}
    assert place.read_bytes() == CONTENT
    assert (place.parent / "theirs.toml").read_bytes() == (folder / "theirs.toml").read_bytes()


def test_what_is_there_is_not_fetched_again(folder, monkeypatch) -> None:
    place = folder / "files/someone/robots" / PATH
    place.parent.mkdir(parents=True)
    place.write_bytes(CONTENT)
    asked = answer(b"", monkeypatch)
    path = listed(folder, PUBLISHED.replace("theirs.toml", PATH))
    assert policy_list.resolve_references(policy_list.read_list(path), path, folder / "files", fetch=True)[
        "theirs"
    ] == str(place)
    assert asked == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"robot": "go3"}, "unknown robot 'go3'; there are simple_quad"),
        ({"ours": '"trot", "trott"', "published": ""}, "trott"),
        ({"ours": '"trot", "theirs"'}, "one twice"),
        ({"ours": "3"}, "PolicyList.ours is of the type"),
        ({"published": "= 3"}, "is no list of policies (TOMLDecodeError"),
        ({"published": PUBLISHED.replace("revision", "version")}, "'version'"),
        ({"published": PUBLISHED.replace("https", "http")}, "wants a source https://"),
        ({"published": PUBLISHED.replace("someone/robots", "../robots")}, "wants a source https://"),
        ({"published": PUBLISHED.replace(PATH, "../go1.onnx")}, "not in its repository"),
        ({"published": PUBLISHED.replace("theirs.toml", "/theirs.toml")}, "not in its repository"),
        ({"published": PUBLISHED.replace('= "', '= "x')}, "is no list of policies"),
    ],
)
def test_a_faulty_list_is_one_line(folder, refused, monkeypatch, change, said) -> None:
    answer(CONTENT, monkeypatch)
    (folder / "theirs.toml").touch()
    assert said in refused(main, "leaderboard", listed(folder, **change), "--fetch")


def test_a_reference_is_one_of_the_list(folder, refused) -> None:
    said = refused(main, "leaderboard", listed(folder), "--reference", "robust")
    assert "robust is not in the list: trot, stand, theirs" in said


def test_gains_that_differ_by_joint_are_all_shown() -> None:
    assert format_gains(SIMPLE_QUAD) == "300; 10"
    of_knees = SimpleNamespace(servo_stiffness=np.resize((20.0, 20.0, 40.0), 12), servo_damping=0.5)
    assert format_gains(of_knees) == "20, 40; 0.5"
