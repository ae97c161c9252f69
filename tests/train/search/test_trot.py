"""Search of the trot: its fits by hand, its batch of candidates, its cost, and its output files."""

import dataclasses
import math

import numpy as np
import pytest

from evaluate.measures.metrics import MEASURE_NAMES, Measures
from policies.trot.open_loop import SEARCH_RANGES, TrotParameters
from quad_env.seeding import episode_seeds
from train.search import trot
from train.search.cmaes import decode, encode
from train.search.trot import (
    WEAK_RESPONSE_WEIGHT,
    candidate_costs,
    fit_command_map,
    fit_command_response,
    invert_command_response,
    try_invert_command_response,
)

COMMANDS = np.random.default_rng(0).uniform(-1, 1, (6, 2, 3))
RESPONSE = np.array([[0.8, 0.0, 0.1], [0.0, 0.5, 0.3], [0.0, 0.0, 2.0], [-0.1, 0.0, 0.0]])
"""Rows: forward, lateral and yaw command, and the bias; columns: achieved velocity."""


def measures(**changes):
    """Return the measures of six complete episodes with two command intervals."""
    achieved = COMMANDS @ RESPONSE[:3] + RESPONSE[3]
    nothing = {name: np.zeros(6) for name in MEASURE_NAMES}
    return Measures(**nothing | {"commands": COMMANDS, "mean_velocities": achieved} | changes)


def test_intervals_that_ended_in_a_fall_do_not_count_and_too_few_others_are_no_response(monkeypatch):
    monkeypatch.setattr(trot, "measure", lambda walk: walk)
    velocities = measures().mean_velocities.copy()
    velocities[:2, 1] = math.nan
    np.testing.assert_allclose(fit_command_response(measures(mean_velocities=velocities), 1), [RESPONSE], atol=1e-12)
    velocities[1:4] = math.nan  # 5 of 12 intervals remain
    assert not fit_command_response(measures(mean_velocities=velocities), 1).any()


def test_the_map_undoes_the_response():
    """The gait was commanded with twice the yaw rate before."""
    found = invert_command_response(dataclasses.replace(TrotParameters(), yaw_gain=2.0), RESPONSE)
    assert found.forward_gain == pytest.approx(1 / 0.8)
    assert found.forward_bias == pytest.approx(0.1 / 0.8)
    assert found.lateral_gain == pytest.approx(1 / 0.5)
    assert found.yaw_gain == pytest.approx(2.0 / 2.0)
    assert found.yaw_per_lateral == pytest.approx((0.0 - 2.0 * 0.3 / 2.0) / 0.5)


def test_a_response_too_weak_to_be_undone_leaves_the_map_alone(monkeypatch):
    assert try_invert_command_response(TrotParameters(), np.zeros((4, 3))) == TrotParameters()
    beyond = np.eye(4, 3)
    beyond[3, 0] = math.inf  # a bias outside the limits of the parameters
    assert try_invert_command_response(TrotParameters(), beyond) == TrotParameters()
    monkeypatch.setattr(trot, "run_candidates", lambda *_, **__: [measures()])
    monkeypatch.setattr(trot, "measure", lambda walk: walk)
    assert fit_command_map(TrotParameters(), episode_seeds("search", 0, 6), 1).lateral_gain == pytest.approx(2.0)


def test_a_point_of_the_cube_is_a_set_of_parameters_and_back():
    point = np.linspace(0.1, 0.9, len(SEARCH_RANGES))
    parameters = decode(point, TrotParameters(forward_gain=1.5), SEARCH_RANGES)
    np.testing.assert_allclose(encode(parameters, SEARCH_RANGES), point, atol=1e-12)
    assert parameters.forward_gain == 1.5
    for end, corner in enumerate((np.zeros(len(SEARCH_RANGES)), np.ones(len(SEARCH_RANGES)))):
        for name, bounds in SEARCH_RANGES.items():
            assert getattr(decode(corner, TrotParameters(), SEARCH_RANGES), name) == pytest.approx(bounds[end])


def test_standing_still_costs_more_than_walking():
    """A gait that ignores commands has a perfect fit to its own, empty response."""
    still = dataclasses.replace(TrotParameters(), forward_gain=0.0, lateral_gain=0.0, yaw_gain=0.0)
    walking, standing = candidate_costs([TrotParameters(), still], episode_seeds("search", 0, 8), 300, 1)
    assert standing - walking > WEAK_RESPONSE_WEIGHT
