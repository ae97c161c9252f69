"""The README's block for Stable-Baselines3: its numbers belong to the present block, and its policy walks."""

import json
import re
import zipfile
from pathlib import Path

import pytest

from evaluate.measures.outcomes import SUCCESS_RULE
from research.__main__ import main
from research.training.sb3_block import (
    MODEL,
    PLACE,
    SCENARIOS,
    block_digest,
    find_block,
    lowest_success,
    markdown_lines,
    read_record,
)
from tests.seams import short_episodes

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RECORD = read_record(ROOT / "docs/results/sb3_block.json")
PAGE = re.sub(r"\.learn\([\d_]+\)", ".learn(1)", README)
SMALL_PAGE = PAGE.replace("256", "2").replace("2048", "64")
"""Page with a block that trains two robots."""


def test_the_readmes_figures_are_those_of_the_block_above_them() -> None:
    assert RECORD["block_sha256"] == block_digest(find_block(README))
    assert RECORD["success_rule"] == SUCCESS_RULE
    assert f"<!-- {PLACE} -->\n" + "\n".join(markdown_lines(RECORD)) + f"\n<!-- /{PLACE} -->" in README


def test_every_seed_walks_within_half_an_hour_of_one_core_where_standing_never_succeeds() -> None:
    trained, _ = SCENARIOS
    assert lowest_success(RECORD, trained) >= 0.8
    assert max(entry["minutes"] for entry in RECORD["seeds"]) <= 30.0
    assert RECORD["standing"][trained]["successes"] == 0
    assert RECORD["episodes"] >= 96
    assert [entry["seed"] for entry in RECORD["seeds"]] == list(range(len(RECORD["seeds"])))  # no seed is missing


def weights(model: Path) -> bytes:
    with zipfile.ZipFile(model) as file:
        return file.read("policy.pth")


def test_the_command_runs_the_block_of_the_page_with_each_seed_and_writes_the_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short_episodes(monkeypatch, 150)
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    words = ["--seeds", "0", "3", "--episodes", "2", "--page", str(page), "--record", str(tmp_path / "record.json")]
    assert main(["sb3-block", *words, "--out", str(tmp_path / "out")]) == 0
    record = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    assert (record["steps"], record["episodes"], [entry["seed"] for entry in record["seeds"]]) == (1, 2, [0, 3])
    assert record["block_sha256"] == block_digest(find_block(PAGE)) != RECORD["block_sha256"]
    assert all(entry["minutes"] > 0.0 for entry in record["seeds"])
    assert weights(tmp_path / "out" / "seed-0" / MODEL) != weights(tmp_path / "out" / "seed-3" / MODEL)
    written = page.read_text(encoding="utf-8")
    assert "\n".join(markdown_lines(record)) in written
    assert "\n".join(markdown_lines(record)) in capsys.readouterr().out
    assert written.split(f"<!-- /{PLACE} -->")[1] == PAGE.split(f"<!-- /{PLACE} -->")[1]


@pytest.mark.parametrize(
    ("page", "options", "complaint"),
    [
        (PAGE.replace("seed = 0\n", ""), "", "one line 'seed = 0'"),
        (PAGE.replace(".learn(1)", ".learn(total)"), "", "one .learn(STEPS)"),
        (PAGE.replace("<!-- sb3 -->", ""), "", "no <!-- sb3 -->"),
        (PAGE, "--seeds 1 1", "--seeds"),
        (PAGE, "--seeds -1", "--seeds"),
        (PAGE, "--episodes 0", "--episodes"),
    ],
)
def test_a_mistake_is_one_line_before_anything_is_trained(
    page: str, options: str, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("page.md").write_text(page, encoding="utf-8")
    assert complaint in refused(main, "sb3-block", "--page", "page.md", *options.split())
    assert [path.name for path in tmp_path.iterdir()] == ["page.md"]


def test_a_second_run_trains_only_seeds_that_are_missing_and_the_first_again_after_a_change_of_the_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short_episodes(monkeypatch, 110)
    page = tmp_path / "page.md"
    record = tmp_path / "record.json"
    options = ["--episodes", "1", "--page", str(page), "--record", str(record), "--out", str(tmp_path / "out")]

    def trained(text: str, *seeds: str) -> tuple[list[float], list[int]]:
        page.write_text(text, encoding="utf-8")
        assert main(["sb3-block", "--seeds", *seeds, *options]) == 0
        times = [(tmp_path / "out" / f"seed-{seed}" / MODEL).stat().st_mtime_ns for seed in seeds]
        return [entry["minutes"] for entry in read_record(record)["seeds"]], times

    minutes, times = trained(SMALL_PAGE, "0")
    both_minutes, both_times = trained(SMALL_PAGE, "0", "1")
    assert (both_minutes[0], both_times[0]) == (minutes[0], times[0])
    said = [line for line in capsys.readouterr().out.splitlines() if "not trained again" in line]
    assert len(said) == 1
    assert said[0].startswith("seed 0: ")
    _, changed_times = trained(SMALL_PAGE.replace(".learn(1)", ".learn(2)"), "0")
    assert changed_times[0] > times[0]


def test_search_episodes_are_other_ones_and_the_page_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short_episodes(monkeypatch, 110)
    page = tmp_path / "page.md"
    page.write_text(SMALL_PAGE, encoding="utf-8")
    words = ["--seeds", "0", "--episodes", "2", "--page", str(page), "--record", str(tmp_path / "record.json")]
    written = {}
    for purpose in ("evaluation", "search"):
        assert main(["sb3-block", *words, "--purpose", purpose, "--out", str(tmp_path / "out")]) == 0
        written[purpose] = (page.read_text(encoding="utf-8"), read_record(tmp_path / "record.json"))
    text, record = written["search"]
    other_text, other_record = written["evaluation"]
    assert "2 search episodes" in text
    assert "--purpose search`" in text
    assert "2 held-out episodes" in other_text
    assert "--purpose" not in other_text.split(f"<!-- {PLACE} -->")[1]
    assert record["standing"] != other_record["standing"]  # velocity errors of other commands
