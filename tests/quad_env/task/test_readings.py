"""Readings for measurement equal MuJoCo's values of the same step, and change no other bit."""

import gymnasium as gym
import numpy as np
import pytest

import policies
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.energy import JOINT_READINGS
from quad_env.physics.simulation import Simulation, SimulationConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import Scenario

SEED = 5
WIDTHS = {
    "position": (3,),
    "quaternion": (4,),
    "angular_velocity": (3,),
    "height": (),
    "tilt": (),
    "joint_position": (12,),
    "joint_velocity": (12,),
    "joint_torque": (12,),
    "action": (12,),
    "foot_position": (4, 3),
    "foot_height": (4,),
    "foot_contact": (4,),
    "leg_contact": (),
    "trunk_contact": (),
    "push": (2,),
    **dict.fromkeys(JOINT_READINGS, (12,)),
    "foot_impulse": (4,),
}


def trot(num_envs: int, steps: int, *, scenario: str = "push", readings: bool = True, **options):
    """Return the result of each step of robots that continue after a fall; the last entry is the env."""
    env = SimpleQuadVectorEnv(num_envs, scenario, readings=readings, terminate_on_fall=False, **options)
    policy = policies.make("trot")
    policy.reset(num_envs)
    observation, _ = env.reset(seed=SEED)
    for _ in range(steps):
        result = env.step(policy.act(observation))
        observation = result[0]
        yield *result, env


def test_every_reading_has_its_shape_and_a_copy_of_its_own() -> None:
    env = gym.make_vec("SimpleQuad-v0", num_envs=3, readings=True)
    _, infos = env.reset(seed=SEED)
    assert {name: infos[name].shape[1:] for name in WIDTHS} == WIDTHS
    before = {name: infos[name].copy() for name in WIDTHS}
    env.step(np.tile(SIMPLE_QUAD.home_pose.astype(np.float32), (3, 1)))
    for name in WIDTHS:
        assert infos[name].shape[0] == 3
        np.testing.assert_array_equal(infos[name], before[name], err_msg=name)


def test_readings_change_no_other_bit() -> None:
    runs = zip(trot(3, 60, scenario="rough"), trot(3, 60, scenario="rough", readings=False), strict=True)
    for (*looked, with_readings, _), (*blind, without, _) in runs:
        assert not set(WIDTHS) & set(without)
        for one, other in zip(looked, blind, strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(with_readings["heading_velocity"], without["heading_velocity"])
        np.testing.assert_array_equal(with_readings["mechanical_power"], without["mechanical_power"])


def test_a_robot_reads_the_same_bits_alone_and_in_a_batch() -> None:
    alone, batch = trot(1, 60), trot(7, 60, nthread=1)
    for (*_, one, _), (*_, many, _) in zip(alone, batch, strict=True):
        for name in WIDTHS:
            np.testing.assert_array_equal(one[name][0], many[name][0], err_msg=name)


@pytest.mark.parametrize("scenario", ["flat", "rough"])
def test_readings_are_those_of_mujoco_after_the_same_step(scenario: str) -> None:
    for step, (*_, infos, env) in enumerate(trot(2, 60, scenario=scenario)):
        if step % 7:
            continue
        data, read = env.simulation.snapshot(1), {name: infos[name][1] for name in WIDTHS}
        trunk = data.body("base_link")
        feet = np.array([data.site(f"{leg}_foot").xpos for leg in SIMPLE_QUAD.leg_names])
        np.testing.assert_allclose(read["position"], trunk.xpos, atol=1e-12)
        np.testing.assert_allclose(read["quaternion"], trunk.xquat, atol=1e-12)
        np.testing.assert_allclose(read["angular_velocity"], data.qvel[3:6], atol=1e-12)
        np.testing.assert_allclose(np.cos(read["tilt"]), trunk.xmat[8], atol=1e-12)
        np.testing.assert_allclose(read["joint_position"], data.qpos[7:], atol=1e-12)
        np.testing.assert_allclose(read["joint_velocity"], data.qvel[6:], atol=1e-12)
        np.testing.assert_allclose(read["action"], data.ctrl, atol=1e-12)
        np.testing.assert_allclose(read["foot_position"], feet, atol=1e-12)
        ground = env.scenario.terrain.height(feet[:, 0], feet[:, 1])
        np.testing.assert_allclose(read["foot_height"], feet[:, 2] - SIMPLE_QUAD.foot_radius - ground, atol=1e-12)
        assert (np.abs(read["joint_torque"]) <= SIMPLE_QUAD.rated_torque).all()


def test_contacts_are_those_of_the_last_substep() -> None:
    """With one substep a step, the state before the last substep is known: MuJoCo's contacts there are the readings."""
    simulation = Simulation(SIMPLE_QUAD, Scenario("made"), SimulationConfig(control_rate=500.0, has_meter=True))
    model = simulation.model
    rng = np.random.default_rng(0)
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    seen = set()
    for step in range(600):
        before = simulation.snapshot(0)
        legs_folded = step > 300
        simulation.step(SIMPLE_QUAD.home_pose + (0.9 * legs_folded) * rng.normal(0, 1.0, (1, 12)), np.zeros((1, 2)))
        ground = model.geom("ground").id
        touching = {model.geom(int(geom)).name for pair in before.contact.geom if ground in pair for geom in pair}
        feet, leg = simulation.ground_contacts()
        assert feet[0].tolist() == [f"{name}_foot" in touching for name in SIMPLE_QUAD.leg_names]
        assert leg[0] == any(name.endswith(("thigh", "calf")) for name in touching)
        seen.add((*feet[0].tolist(), bool(leg[0])))
    assert {leg for *_, leg in seen} == {False, True}
    assert len(seen) > 4, "several footholds must occur for this to show anything"
