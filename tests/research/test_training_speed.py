"""The command `training-speed` writes measured values of training into a page."""

import json

import pytest

from research.__main__ import main
from research.pages.training_speed import PARTS

PAGE = """above
<!-- training-physics -->
old
<!-- /training-physics -->
between
<!-- training-sample -->
<!-- /training-sample -->
"""


def quartiles(value: float) -> dict[str, float]:
    return {"median": value, "low": 0.9 * value, "high": 1.1 * value}


def record() -> dict:
    physics = {
        "default of a training": {"us": quartiles(60.0), "steps/s": 1e6 / 60.0, "speed": quartiles(1.0)},
        "--physics.contacts feet": {"us": quartiles(50.0), "steps/s": 2e4, "speed": quartiles(1.2)},
    }
    sample = {name: quartiles(2.0 + index) for index, name in enumerate(PARTS)}
    machine = {"cpu": "a processor", "load": 1.0, "mujoco": "3"}
    return {"machine": machine, "figures": {"physics": {"go1": physics}, "sample": {"go1": sample}}}


def test_both_tables_replace_the_blocks(tmp_path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    (tmp_path / "speed.json").write_text(json.dumps(record()), encoding="utf-8")
    assert main(["training-speed", str(tmp_path / "speed.json"), "--page", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith("above\n")
    assert "\nbetween\n" in text
    assert "old" not in text
    assert "| `--physics.contacts feet` | 50.0 | 20,000 | 1.20 [1.08 … 1.32] |" in text
    assert "| physics: MuJoCo | 2.0 [1.8 … 2.2] |" in text
    assert text.count("a processor, load 1.0, MuJoCo 3") == 2


def test_a_measurement_that_is_missing_keeps_its_block(tmp_path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    content = record()
    del content["figures"]["physics"]
    (tmp_path / "speed.json").write_text(json.dumps(content), encoding="utf-8")
    assert main(["training-speed", str(tmp_path / "speed.json"), "--page", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "old" in text
    assert "| physics: MuJoCo | 2.0 [1.8 … 2.2] |" in text


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"figures": {"physics": {}}}'])
def test_another_file_gets_one_line_and_the_page_stays(content: str, tmp_path, refused) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    (tmp_path / "speed.json").write_text(content, encoding="utf-8")
    message = refused(main, "training-speed", str(tmp_path / "speed.json"), "--page", str(page))
    assert "valid: a file of its option --json" in message
    assert page.read_text(encoding="utf-8") == PAGE
