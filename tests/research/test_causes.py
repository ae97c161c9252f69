"""Study of causes: its tables, films that hide the cause, and the comparison with a person's answers."""

import csv
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from quad_env.scenarios.registry import scenario
from quad_env.seeding import episode_seeds
from research.__main__ import main
from research.studies import causes


def rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))


@pytest.fixture
def page(tmp_path) -> Path:
    """Create a page with all places for tables."""
    page = tmp_path / "causes.md"
    page.write_text(
        "".join(f"<!-- {place} -->\n<!-- /{place} -->\n" for place in ("thresholds", "agreement", "reading"))
    )
    return page


def test_table_and_page_have_every_cause_and_every_threshold(tmp_path, page, monkeypatch) -> None:
    monkeypatch.setattr(causes, "CASES", [case for case in causes.CASES if case.cause == "gait"])
    assert main(["causes", "--table", str(tmp_path / "causes.csv"), "--page", str(page)]) == 0
    found = {row["made_for"]: row for row in rows(tmp_path / "causes.csv")}
    assert list(found) == list(causes.CAUSES)
    assert (found["gait"]["episodes"], found["gait"]["right"], found["trip"]["episodes"]) == ("12", "12", "0")
    text = page.read_text()
    assert "| gait | 12 | 12 | 12 | 0 |" in text
    assert all(f"| {name} | {value} |" in text for name, (value, _, _) in causes.THRESHOLDS.items())


@pytest.mark.rendering
def test_films_show_falls_and_upright_failures_and_do_not_say_the_cause(tmp_path, monkeypatch) -> None:
    seeds, fell = episode_seeds("validation", 0, 2), np.array([True, False])
    measures = SimpleNamespace(fell=fell, succeeded=np.zeros(2, bool))
    cell = SimpleNamespace(policy="trot", scenario=scenario("force:6"), seeds=seeds, measures=measures)
    monkeypatch.setattr(causes, "read_run", lambda _: SimpleNamespace(cells=(cell, cell)))
    films = tmp_path / "films"
    assert main(["causes", "--films", str(films), "--count", "1"]) == 0
    assert [file.name for file in films.iterdir()] == ["00.png"]
    (key,) = rows(tmp_path / "key.csv")
    assert (key["film"], key["policy"], key["cause"]) == ("00.png", "trot", "pushed_over")
    with Image.open(films / "00.png") as strip:
        assert strip.width == 5 * 340


READ = "film,cause,remark\n0.png,trip,sees it\n1.png,slip,\n2.png,slip,\n"


def reading(folder: Path, page: Path, text: str) -> list[str]:
    """Return the arguments of the command that compares answers with a key of three films."""
    (folder / "read.csv").write_text(text)
    (folder / "key.csv").write_text("film,cause,certain\n0.png,trip,True\n1.png,trip,True\n2.png,slip,False\n")
    files = {"reading": folder / "read.csv", "key": folder / "key.csv", "page": page, "table": folder / "causes.csv"}
    return ["causes", *(str(word) for name, file in files.items() for word in (f"--{name}", file))]


def test_a_reading_is_compared_with_the_rules(tmp_path, page) -> None:
    assert main(reading(tmp_path, page, READ)) == 0
    text = page.read_text()
    assert "on 2 of 3 films, on 1 of the 2 where the rules are certain" in text
    assert "| trip | 1 | 1 |\n| slip |  | 1 |" in text
    first = rows(tmp_path / "causes_films.csv")[0]
    assert first == {"film": "0.png", "cause": "trip", "certain": "True", "read": "trip", "remark": "sees it"}


@pytest.mark.parametrize(
    "text", ["film,cause\n0.png,trip\n", "film\n", "film,cause\n0.png,x\n1.png,slip\n2.png,slip\n"]
)
def test_a_reading_that_does_not_fit_is_refused(tmp_path, page, refused, text: str) -> None:
    before = page.read_text()
    line = refused(main, *reading(tmp_path, page, text))
    assert "film" in line or "unknown cause" in line
    assert page.read_text() == before
