"""Learning curve of a run: its validations over training steps."""

from typing import Any

import numpy as np
import pytest

from train.learning_curve import draw_curve


def validation(steps: int, success: float, cost: float | None = None) -> dict[str, Any]:
    return {"steps": steps, "success": success, "cost_of_transport": cost, "scenarios": {}}


def test_success_in_per_cent_and_cost_of_transport_are_drawn_over_steps() -> None:
    curve = draw_curve([validation(1000, 0.2, 1.5), validation(2000, 0.6, 0.75)], "mine")
    success, cost = (axes.get_lines()[0] for axes in curve.axes)
    np.testing.assert_allclose(success.get_xydata(), [[1000.0, 20.0], [2000.0, 60.0]])
    np.testing.assert_allclose(cost.get_xydata(), [[1000.0, 1.5], [2000.0, 0.75]])
    assert [axes.get_ylabel() for axes in curve.axes] == ["success in validation, %", "cost of transport"]
    assert curve.axes[0].get_title() == "mine"


@pytest.mark.parametrize("cost", [None, np.nan])
def test_without_any_cost_of_transport_only_success_is_drawn(cost: float | None) -> None:
    assert len(draw_curve([validation(1000, 0.2, cost)], "").axes) == 1
    assert len(draw_curve([{"steps": 1, "success": 0.5}], "").axes) == 1
