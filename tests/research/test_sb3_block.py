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
