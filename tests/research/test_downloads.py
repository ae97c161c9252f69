"""`python -m research downloads` writes a ZIP file of each shipped walk in each format, and the table of them."""

import hashlib
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import policies
from policies import bundle
from policies.history import Inputs
from policies.input_terms import DEPLOYABLE_TERMS
from quad_env.robots.registry import get_robot
from research.__main__ import main
from tests.train.export.plain_policies import make_policy

PAGE = "before\n<!-- downloads -->\n<!-- /downloads -->\nafter\n"


def test_each_walk_is_written_in_each_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path / "models")
    policy = make_policy(get_robot("go2"), Inputs(clock=2.2, terms=DEPLOYABLE_TERMS, history=3), gains=None)
    policy.network.weights[0][...] /= 4.0
    bundle.save(tmp_path / "models/go2/walk", policy, {}, "0" * 40)
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    words = ["downloads", "--out", str(tmp_path / "out"), "--page", str(page), "--url", "https://example.org/files"]
    assert main(words) == 0
    files = {file.name: file for file in (tmp_path / "out").iterdir()}
    assert files.keys() == {f"go2-walk-{name}.zip" for name in ("unitree", "isaac-lab", "toml")}
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n<!-- downloads -->\n| file |")
    for name, file in files.items():
        assert f"[{name}](https://example.org/files/{name})" in text
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    for name in ("mjlab", "rl-sar"):
        assert f"- go2: --to {name}: observation term: " in text
    assert capsys.readouterr().out.strip() in text
    with zipfile.ZipFile(files["go2-walk-toml.zip"]) as archive:
        archive.extractall(tmp_path)
    program = [sys.executable, "-I", str(tmp_path / "go2-walk-toml/run.py"), "--headless", "0.1"]
    assert "distance" in subprocess.run(program, capture_output=True, text=True, check=True, timeout=120).stdout


def test_without_a_walk_the_page_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path / "models")
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    assert main(["downloads", "--out", str(tmp_path / "out"), "--page", str(page)]) == 2
    assert "no robot has a shipped policy walk" in capsys.readouterr().err
    assert page.read_text(encoding="utf-8") == PAGE
    assert not (tmp_path / "out").exists()


def test_the_page_of_the_project_has_the_place_of_the_table(repository: Path) -> None:
    text = (repository / "docs/deployment-files.md").read_text(encoding="utf-8")
    assert "<!-- downloads -->\n" in text
