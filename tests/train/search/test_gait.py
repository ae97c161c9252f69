"""A gait's search: its point of the cube, its response, its cost, and what it writes."""

from dataclasses import replace

import numpy as np

from policies.gaits.parameters import searched_parameters
from quad_env.seeding import episode_seeds
from train.search.gait import commands, cost, shared_walk


def test_commands_stay_within_the_range_and_half_go_straight():
    drawn = commands("walk", 40, np.random.default_rng(0))
    assert (drawn[:20, 1:] == 0.0).all()
    np.testing.assert_allclose(drawn[[0, 19], 0], [0.12, 0.4])
    assert (np.abs(drawn) <= [0.4, 0.3, 0.6]).all()


def test_a_spoilt_gait_costs_more():
    command = commands("trot", 8, np.random.default_rng(3))
    good = searched_parameters()["trot"]
    spoilt = [
        replace(good, **change) for change in ({"body_height": 0.12}, {"forward_gain": 0.3}, {"stance_shift": 0.12})
    ]
    first, *others = shared_walk("trot", [good, *spoilt], command, episode_seeds("search", 9, 8), 260, 1)
    assert all(cost(walk, command) > cost(first, command) + 0.5 for walk in others)


def test_the_cost_of_a_gait_does_not_depend_on_the_other_candidates():
    drawn = episode_seeds("search", 3, 8)
    command = commands("bound", 8, np.random.default_rng(drawn))

    def costs(*candidates):
        return [cost(walk, command) for walk in shared_walk("bound", list(candidates), command, drawn, 250, 1)]

    pronk, bound = searched_parameters()["pronk"], searched_parameters()["bound"]
    assert costs(pronk, bound) == costs(pronk) + costs(bound)
