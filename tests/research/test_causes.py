"""The confusion table of causes is written into its page; films are drawn without what the rules say of them."""

import csv
from pathlib import Path

import pytest
from PIL import Image

from research.__main__ import main
from research.studies import causes


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))


def test_table_and_page_have_every_cause_and_every_threshold(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(causes, "CASES", [case for case in causes.CASES if case.cause == "gait"])
    page = tmp_path / "causes.md"
    page.write_text("<!-- thresholds -->\n<!-- /thresholds -->\n<!-- agreement -->\n<!-- /agreement -->\n")
    assert main(["causes", "--table", str(tmp_path / "causes.csv"), "--page", str(page)]) == 0
    found = {row["made_for"]: row for row in rows(tmp_path / "causes.csv")}
    assert list(found) == list(causes.CAUSES)
    assert (found["gait"]["episodes"], found["gait"]["right"], found["trip"]["episodes"]) == ("12", "12", "0")
    text = page.read_text()
    assert "| gait | 12 | 12 | 12 | 0 |" in text
    assert all(f"| {name} | {value} |" in text for name, (value, _, _) in causes.THRESHOLDS.items())


@pytest.mark.rendering
def test_a_film_shows_the_fall_and_its_form_says_nothing_of_the_cause(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(causes, "POLICIES", ("trot",))
    monkeypatch.setattr(causes, "SCENARIOS", ("force:6",))
    assert main(["causes", "--films", str(tmp_path / "films"), "--count", "2"]) == 0
    assert rows(tmp_path / "films" / "readings.csv") == [
        {"film": f"{number:02d}.png", "cause": "", "certain": "", "remark": ""} for number in range(2)
    ]
    key = rows(tmp_path / "films_key.csv")
    assert {row["cause"] for row in key} == {"pushed_over"}
    with Image.open(tmp_path / "films" / key[0]["film"]) as strip:
        assert strip.width == 6 * causes.SIZE[0] or strip.width % causes.SIZE[0] == 0
        assert strip.height % causes.SIZE[1] == 0
