"""A policy that does not walk with its specification causes a warning before the first
episode; the evaluation continues.
"""

import json
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.rollouts import diagnosis
from tests.seams import short_episodes

RUN = ("--policies", "stand", "trot", "--scenarios", "flat", "--episodes", "1")


@pytest.mark.usefixtures("no_page")
def test_a_failed_check_is_one_line_once(capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def warning(policy, robot: str) -> str | None:
        return f"on {robot} it leans" if policy.name == "stand" else None

    short_episodes(monkeypatch, 110)
    monkeypatch.setattr(diagnosis, "warning", warning)
    assert main([*RUN, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().err.splitlines()[0] == "warning: stand: on simple_quad it leans"
    assert set(json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["policies"]) == {"stand", "trot"}
    (tmp_path / "episodes.parquet").unlink()
    assert main(["--resume", "--out", str(tmp_path)]) == 0
    assert "warning" not in capsys.readouterr().err
