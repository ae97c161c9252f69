import gymnasium as gym
import numpy as np
import pytest

import policies
from policies.contacts import duty_factors, landing_offsets, landings, on_flat_ground, wrapped
from policies.gait import WALK_OFFSETS, Gait
from quad_env import OBSERVATION
from quad_env.robot import HOME_HEIGHT, HOME_POSE

DOWN = np.array([0.0, 0.0, -1.0])


def test_feet_of_the_home_pose_touch_just_below_the_height_at_which_it_stands():
    heights = HOME_HEIGHT + np.array([-1e-4, 1e-4])
    touching = on_flat_ground(heights, np.tile(DOWN, (2, 1)), np.tile(HOME_POSE, (2, 1)))
    assert touching.tolist() == [[True] * 4, [False] * 4]


def test_a_trunk_that_rolls_to_the_left_lifts_the_right_feet():
    rolled = np.array([0.0, np.sin(0.05), -np.cos(0.05)])  # left side, +y, down
    # Feet 0.25 m out, 0.25 sin(0.05) = 12 mm down or up.
    assert on_flat_ground(np.array(HOME_HEIGHT), -rolled * -1.0, HOME_POSE).tolist() == [True, False, True, False]


def test_contacts_are_those_that_the_simulation_finds():
    env = gym.make("SimpleQuad-v0")
    policy = policies.make("walk")
    observation, _ = env.reset(seed=3, options={"command": (0.3, 0.0, 0.0)})
    agree, lifted = [], []
    for _ in range(200):
        observation, *_ = env.step(policy.act(observation))
        data = env.unwrapped.data
        found = [data.sensor(f"{leg}_foot_touch").data[0] > 0.0 for leg in ("fl", "fr", "hl", "hr")]
        joints = data.qpos[7:]
        ours = on_flat_ground(data.qpos[2], observation[OBSERVATION["projected_gravity"]].astype(np.float64), joints)
        agree.append(ours == found)
        lifted.append(~ours)
    assert np.mean(lifted) > 0.1
    assert np.mean(agree) > 0.99  # float32 gravity
    env.close()


def stepping(duty, offsets=WALK_OFFSETS):
    """Contacts, places in the cycle, duty factors and clock of a gait with 40 control steps a cycle."""
    phase = 2.0 * np.pi * (np.arange(1000) + 0.5) / 40.0
    contacts = ~Gait(offsets, duty).legs(phase).swing
    return contacts, (phase[:, None] + np.array(offsets)) / (2.0 * np.pi) % 1.0, np.full(1000, duty), phase


@pytest.mark.parametrize("duty", [0.4, 0.75])
def test_a_gaits_own_contacts_have_its_duty_and_its_offsets(duty):
    contacts, cycles, duties, phase = stepping(duty)
    np.testing.assert_allclose(duty_factors(contacts), duty, atol=1e-9)
    landed = landings(contacts, cycles, duties)
    assert (landed[40:].sum(axis=0) == 24).all()
    beside = wrapped(landing_offsets(landed, phase) - [0.0, 0.5, 0.25, 0.75])
    np.testing.assert_allclose(beside, 0.0, atol=1e-9)


def test_a_foot_that_lands_late_is_behind_by_that_and_a_bounce_in_its_stance_is_no_landing():
    contacts, cycles, duties, phase = stepping(0.5, (0.0,) * 4)
    contacts[20::40, 1] = False  # one control step late, a fortieth of a cycle
    contacts[30::40, 2] = False
    contacts[:, 3] = False
    offsets = landing_offsets(landings(contacts, cycles, duties), phase)
    np.testing.assert_allclose(offsets[:3], [0.0, -0.025, 0.0], atol=1e-9)
    assert np.isnan(offsets[3])


def test_wrapped_by_hand():
    np.testing.assert_allclose(wrapped(np.array([0.0, 0.5, 0.75, -0.6, 1.2])), [0.0, -0.5, -0.25, 0.4, 0.2])
