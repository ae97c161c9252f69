"""Gaits under model-predictive control: feet land in the gait's order, and gaits may have flight phases."""

from typing import NamedTuple

import numpy as np
import pytest

import policies
from evaluate.rollouts.observers import FallRecorder, Step
from evaluate.rollouts.rollout import roll_out
from policies.gait_cycle import TURN, leg_phases
from policies.gaits.parameters import OFFSETS
from policies.mpc.contact import classify_contacts
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from quad_env.seeding import episode_seeds
from tests.policies.gaits.strides import duty_factors, landing_offsets, landings, wrapped

ROBOTS, STEPS, FROM = 2, 300, 100
SPEED = 0.5


class Walked(NamedTuple):
    """Recorded steps of robots, from `FROM` on."""

    contacts: np.ndarray
    phase: np.ndarray
    heading_velocity: np.ndarray
    fell: np.ndarray


def walked(policy: MpcWbc) -> Walked:
    falls, seen = FallRecorder(ROBOTS, STEPS), []

    def look(step: Step) -> None:
        if step.number:
            falls(step)
        if step.number > FROM:
            seen.append((step.infos["foot_contact"], policy.phase, step.infos["heading_velocity"]))

    roll_out(policy, "flat", episode_seeds("search", 9, ROBOTS), look, steps=STEPS, command=(SPEED, 0.0, 0.0))
    return Walked(*(np.array(each) for each in zip(*seen, strict=True)), falls.fell)


@pytest.mark.parametrize("gait", OFFSETS)
def test_it_walks_straight_and_its_feet_land_in_the_order_of_the_gait(gait: str) -> None:
    """The landing order of another gait differs by at least a quarter of a cycle.

    The bound's hind legs differ by 0.14.
    """
    policy = policies.make("mpc_wbc" if gait == "trot" else f"mpc_wbc_{gait}")
    found, duty = walked(policy), policy.parameters.duty
    assert not found.fell.any()
    assert not policy.failures.any()
    mean = np.tile([SPEED, 0.0, 0.0], (ROBOTS, 1))
    np.testing.assert_allclose(found.heading_velocity.mean(axis=0), mean, atol=0.12)
    cycles = leg_phases(found.phase, policy.leg_offsets) / TURN
    landed = landings(found.contacts, cycles, np.full(found.phase.shape, duty))
    assert landed.sum(axis=0).min() >= 0.8 * policy.frequency * policy.control_period * len(landed)
    ahead = landing_offsets(landed, found.phase)
    np.testing.assert_allclose(wrapped(ahead - np.array(OFFSETS[gait]) / TURN), 0.0, atol=0.18)
    np.testing.assert_allclose(duty_factors(found.contacts), duty, atol=0.15)
    # The pronk commands a flight phase of 0.55 of the time.
    assert gait != "pronk" or (~found.contacts).all(axis=-1).mean() > 0.35


@pytest.mark.parametrize(("gait", "bearing"), [("trot", 2), ("pronk", 0)])
def test_feet_that_are_late_all_together_bear_a_robot_unless_its_gait_flies(gait: str, bearing: int) -> None:
    policy = MpcWbc(gait=gait)
    policy.act(np.r_[0.0, 0.0, -1.0, np.zeros(45)])
    early_in_the_stance = policy._gait.legs(np.array([TURN * (1.1 - policy.parameters.duty)]))
    legs, new = early_in_the_stance, np.zeros(1, np.bool_)
    contacts = classify_contacts(policy.parameters, legs, legs, np.zeros((1, 4)), new, flies=policy._gait.has_flight)
    assert contacts.stance.sum() == bearing
    assert contacts.late.any()


def test_a_flight_longer_than_the_horizon_has_a_plan_without_forces() -> None:
    long = MpcWbc(MpcParameters(frequency=0.5, duty=0.1), gait="pronk")
    for _ in range(20):
        actions = long.act(np.r_[0.0, 0.0, -1.0, np.zeros(45)])
    assert np.isfinite(actions).all()
    assert not long.failures.any()
    assert not long._plans.forces.any()
