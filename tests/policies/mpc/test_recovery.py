"""The model-predictive controllers compensate lost distance and lift their feet higher on rough ground."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from policies.contact.motion_state import compute_motion_state
from policies.mpc.motion import PositionFeedback
from policies.mpc.parameters import MpcParameters, parameters_of
from policies.mpc.policy import MpcWbc
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

P = replace(parameters_of("trot"), position_gain=0.5, farthest_behind=0.6)


def commands(
    seconds: float, p: MpcParameters = P, *, then: tuple[float, float, float] | None = None, **terms: Any
) -> np.ndarray:
    """Return the corrected commands of two robots after some time at constant readings; the second has no error."""
    odometer, asked = PositionFeedback(p.farthest_behind, 0.01, p.fastest_return), np.zeros((2, 3))
    odometer.reset(2)
    rows = reading(2, command=[0.4, 0.0, 0.2])
    rows[1] = reading(command=[0.4, 0.0, 0.2], linear_velocity=[0.4, 0.0, 0.0], angular_velocity=[0.0, 0.0, 0.2])
    for name, values in terms.items():
        rows[0] = reading(command=[0.4, 0.0, 0.2], **{name: values})
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), rows)
    for _ in range(1 + round(100 * seconds)):
        asked = odometer.with_position_feedback(now, p.position_gain).command
    if then is None:
        return asked
    return odometer.with_position_feedback(now._replace(command=np.tile(then, (2, 1))), p.position_gain).command


def test_a_second_of_standing_is_made_up_for_in_proportion_to_the_distance_and_the_angle() -> None:
    behind, on_time = commands(1.0)
    np.testing.assert_allclose(behind, [0.4 + 0.5 * 0.4, 0.0, 0.2 + 0.5 * 0.2], atol=1e-6)
    np.testing.assert_allclose(on_time, [0.4, 0.0, 0.2], atol=1e-6)


def test_what_was_carried_too_far_is_gone_back() -> None:
    assert commands(0.5, linear_velocity=[0.4, 1.0, 0.0])[0, 1] == pytest.approx(-0.5 * 0.5)


def test_no_more_than_the_farthest_distance_is_made_up_for() -> None:
    assert commands(10.0)[0, 0] == pytest.approx(0.4 + 0.5 * 0.6)


def test_no_higher_speed_is_asked_for_than_the_fastest_or_the_command_itself() -> None:
    swift = replace(P, fastest_return=0.5)
    aside = commands(1.0, swift, linear_velocity=[0.1, 0.6, 0.0])[0]
    np.testing.assert_allclose(aside[:2], 0.5 * np.array([0.55, -0.3]) / np.hypot(0.55, 0.3), atol=2e-3)
    np.testing.assert_allclose(commands(10.0, replace(P, fastest_return=0.3))[0, :2], [0.4, 0.0], atol=1e-6)


def test_a_new_command_forgives() -> None:
    np.testing.assert_array_equal(commands(1.0, then=(0.3, 0.1, 0.0)), np.tile([0.3, 0.1, 0.0], (2, 1)))


def test_feet_are_lifted_higher_by_how_far_the_footprints_are_off_their_plane() -> None:
    policy = MpcWbc(replace(P, roughness_gain=4.0))
    policy.reset(num_envs=2)
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(2))
    policy.terrain_estimator.footprints = now.bodies.feet.T.copy()
    policy.terrain_estimator.footprints[2, :, 0] += [0.01, -0.01, -0.01, 0.01]
    for _ in range(1000):
        ground = policy.terrain_estimator.ground(now, np.zeros((2, 4), np.bool_))
    aim = now.bodies.feet[..., :2]
    x, y = np.moveaxis(aim, -1, 0)
    lift = [
        policy._swing_terrain(aim, ground)(x, y, np.full((2, 4), share)) - ground.at(x, y) for share in (0.0, 0.5, 1.0)
    ]
    np.testing.assert_allclose(
        lift, np.array([0.0, 0.04, 0.0])[:, None, None] * [[[1.0], [0.0]]] * np.ones(4), atol=1e-5
    )
