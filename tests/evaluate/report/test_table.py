"""The table on the terminal: every figure of a few scenarios, falls and breaking points of many."""

import dataclasses
import io

from rich.console import Console

from evaluate.analysis.results import analyse
from evaluate.report.table import print_results


def printed(results) -> list[str]:
    stream = io.StringIO()
    print_results(results, Console(file=stream, width=80))
    return stream.getvalue().replace("\u00a0", " ").splitlines()


def test_a_few_scenarios_have_every_figure(made) -> None:
    text = "\n".join(printed(made))
    assert "velocity" in text
    assert "minus trot" in text


def test_many_scenarios_have_falls_and_breaking_points_in_80_columns(made) -> None:
    nominal = [c for c in made.cells if c.scenario.name == "rough"]
    harder = [
        dataclasses.replace(c, scenario=dataclasses.replace(c.scenario, name="rough:x", severity=0.3)) for c in nominal
    ]
    lines = printed(analyse([*made.cells, *harder], seed=0, episodes=40, complete=True))
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "velocity" not in text
    (push,) = [number for number, line in enumerate(lines) if "impulse" in line]
    trot = next(line.split() for line in lines[push:] if line.split()[:1] == ["trot"])
    assert trot[:5] == ["trot", "0", "50", "85", "95"]
    assert "N·s" in trot
    assert any(line.split() == ["flat", "at", "1.5", "m/s", "0", "0"] for line in lines)
