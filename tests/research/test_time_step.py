"""Study of the physics time step: the cost of transport is independent of the time step."""

import csv

import pytest

from research.__main__ import main
from research.studies import time_step


def test_a_trot_costs_the_same_at_every_physics_step(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(time_step, "STEPS", (0.002, 0.0005))
    path = tmp_path / "steps.csv"
    assert (
        main(["time-step", "--policies", "trot", "--scenarios", "steady", "--episodes", "1", "--table", str(path)]) == 0
    )
    coarse, fine = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    assert (coarse["step"], fine["step"]) == ("0.002", "0.0005")
    assert float(fine["cost_of_transport"]) == pytest.approx(float(coarse["cost_of_transport"]), rel=0.03)
    assert float(fine["step_rate"]) == pytest.approx(4.0, rel=0.05)
