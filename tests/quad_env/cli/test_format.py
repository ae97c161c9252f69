"""Figures as people write them."""

from quad_env.cli.format import interval, listed, number, p_value, percent, points, points_interval


def test_figures_read_as_people_write_them() -> None:
    assert number(-0.12345) == "−0.123"
    assert number(-0.0001) == "0.000"
    assert number(float("nan")) == "–"
    assert interval((-0.1, 0.25)).replace("\u00a0", " ") == "−0.100 … 0.250"
    assert interval((float("nan"), 1.0)) == "–"
    assert [percent(x).replace("\u00a0", " ") for x in (0.0, 0.031, 0.84, 1.0)] == ["0 %", "3.1 %", "84 %", "100 %"]
    assert points_interval((0.0, 0.057)).replace("\u00a0", " ") == "0.0 … 5.7"
    assert points(-0.25) == "−25.0"
    assert [p_value(x).replace("\u00a0", " ") for x in (0.0001, 0.0262, 1.0)] == ["p < 0.001", "p = 0.026", "p = 1.00"]
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
