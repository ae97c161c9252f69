"""The trot with integral action: its correction of the command, which stays bounded under a lasting error."""

import dataclasses

import numpy as np

import policies
from policies.trot.integral import TrotIntegral, integral_parameters
from tests.policies.readings import reading

PERIOD = 0.01


def felt(forward=0.0, yaw_rate=0.0, command=(0.0, 0.0, 0.0), gravity=(0.0, 0.0, -1.0)):
    turning = (0.0, 0.0, yaw_rate)
    moving = {"linear_velocity": (forward, 0.0, 0.0), "angular_velocity": turning, "projected_gravity": gravity}
    return reading(1, command=command, **moving)


def told(policy, monkeypatch):
    """Return the list of commands that the inner trot follows, in order."""
    seen = []
    monkeypatch.setattr(policy, "_follow", lambda command: seen.append(command.copy()))
    return seen


def test_the_integral_of_the_error_is_added_up_to_its_bounds(monkeypatch):
    p = dataclasses.replace(integral_parameters(), integral_gain=2.0, yaw_integral_gain=0.5, largest_error=0.4)
    policy = TrotIntegral(p)
    seen = told(policy, monkeypatch)
    for _ in range(10):
        policy.act(felt(forward=-0.3, yaw_rate=5.0))
    np.testing.assert_allclose(seen[-1], [[10 * PERIOD * 2.0 * 0.3, 0.0, -10 * PERIOD * 0.5 * 0.4]], atol=1e-6)
    for _ in range(1000):
        policy.act(felt(forward=-0.3, yaw_rate=5.0))
    np.testing.assert_allclose(seen[-1], [[p.largest_correction, 0.0, -p.largest_correction]], atol=1e-6)


def test_a_robot_that_takes_up_its_command_as_expected_makes_no_error(monkeypatch):
    policy = policies.make("trot_integral")
    seen = told(policy, monkeypatch)
    velocity, share = 0.0, PERIOD / (PERIOD + integral_parameters().settling_time)
    for _ in range(200):
        velocity += share * (1.0 - velocity)
        policy.act(felt(forward=velocity, command=(1.0, 0.0, 0.0)))
    np.testing.assert_allclose(seen[-1], [[1.0, 0.0, 0.0]], atol=1e-5)


def test_velocity_is_judged_in_the_heading_frame_not_the_body_frame(monkeypatch):
    """A trunk with a pitch of 30 degrees at 1 m/s along its x axis has a forward velocity of cos 30 degrees."""
    policy = policies.make("trot_integral")
    seen = told(policy, monkeypatch)
    policy.act(felt(forward=0.4, gravity=(-0.5, 0.0, -np.sqrt(0.75))))
    np.testing.assert_allclose(seen[-1][0, 0], -PERIOD * integral_parameters().integral_gain * 0.4 * np.sqrt(0.75))
