"""Faults that would affect every number, planted into the real code: each must make a named check fail.

A check compares the environment or the evaluator with physics, geometry or the contract. It passes without a fault, and
fails with its fault.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import policies
import quad_env
from evaluate import cells
from evaluate.cells import evaluation_seeds
from evaluate.measures import metrics
from evaluate.rollouts import rollout
from policies.base import Policy
from quad_env import seeding
from quad_env.columns import Components
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import simulation
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task import rewards
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests, one_call_old

TILTED = replace(quad_env.SCENARIOS["flat"], start=quad_env.StartNoise(tilt=0.4))


def walk(env: gym.Env, command: tuple[float, float, float]):
    """Return observation, reward, info and a snapshot of MuJoCo's data after each of 30 steps of the trot."""
    policy = policies.make("trot")
    policy.reset()
    observation, _ = env.reset(seed=1, options={"command": command})
    for _ in range(30):
        observation, reward, _, _, info = env.step(policy.act(observation))
        yield observation, reward, info, env.unwrapped.data


def part(observation: np.ndarray, name: str) -> np.ndarray:
    return observation[quad_env.OBSERVATION[name]]


def trunk_axes(data: mujoco.MjData) -> np.ndarray:
    """Return the trunk's x, y and z axes in the world as columns, by MuJoCo's kinematics."""
    return data.body("base_link").xmat.reshape(3, 3)


def heading_velocity(data: mujoco.MjData) -> tuple[float, float, float]:
    """Return the forward and lateral velocity of the trunk, heading frame, m/s, and the yaw rate, rad/s."""
    axes = trunk_axes(data)
    nose = axes[:2, 0] / np.linalg.norm(axes[:2, 0])
    return nose @ data.qvel[:2], nose[0] * data.qvel[1] - nose[1] * data.qvel[0], axes[2] @ data.qvel[3:6]


def check_joints_move_when_their_own_target_does() -> None:
    """A target that differs from the home pose in one entry moves the joint of that name more than all others."""
    env = gym.make("SimpleQuad-v0", terminate_on_fall=False)
    for index, name in enumerate(quad_env.JOINT_NAMES):
        target = SIMPLE_QUAD.home_pose.astype(np.float32)
        target[index] += 0.3
        env.reset(seed=0)
        for _ in range(10):
            env.step(target)
        data = env.unwrapped.data
        moved = np.array([data.joint(joint).qpos[0] for joint in quad_env.JOINT_NAMES]) - SIMPLE_QUAD.home_pose
        assert quad_env.JOINT_NAMES[np.argmax(moved)] == name


def check_readings_are_mujocos_of_this_step() -> None:
    """Every reading equals the value from MuJoCo's data, with its frame, axes and joint names."""
    env = gym.make("SimpleQuad-v0")
    for observation, _, info, data in walk(env, (0.5, 0.0, 0.0)):
        axes = trunk_axes(data)
        np.testing.assert_allclose(part(observation, "linear_velocity"), axes.T @ data.qvel[:3], atol=1e-5)
        np.testing.assert_allclose(part(observation, "angular_velocity"), data.qvel[3:6], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(part(observation, "projected_gravity"), -axes[2], atol=1e-6)
        np.testing.assert_allclose(info["heading_velocity"], heading_velocity(data), atol=1e-5)
        angles = [data.joint(name).qpos[0] for name in quad_env.JOINT_NAMES]
        rates = [data.joint(name).qvel[0] for name in quad_env.JOINT_NAMES]
        np.testing.assert_allclose(part(observation, "joint_position") + SIMPLE_QUAD.home_pose, angles, atol=1e-5)
        np.testing.assert_allclose(part(observation, "joint_velocity"), rates, rtol=1e-5, atol=1e-5)


def check_standing_to_the_time_limit_is_no_fall() -> None:
    """A robot that stands until the time limit has not fallen, and has no errors from a fall."""
    episodes = rollout.run(policies.make("stand"), "flat", evaluation_seeds(0, 3), steps=150)
    measures = metrics.measure(episodes)
    assert not measures.fell.any()
    assert np.isnan(measures.fall_time).all()
    np.testing.assert_array_equal(measures.velocity_error, measures.velocity_error_upright)


def check_evaluation_seeds_are_never_drawn_elsewhere() -> None:
    """Every seed of the evaluator is in its family, which is disjoint from the others (`test_seeding`)."""
    evaluated = {int(seed) for run in range(20) for seed in evaluation_seeds(run, 512)}
    assert {seeding.PURPOSES[seed >> 48] for seed in evaluated} == {"evaluation"}
    assert min(evaluated) >= 2**48, "small seeds are the ones that people type"


def check_rewards_are_their_terms_of_this_step() -> None:
    """Tracking, tilt and vertical velocity equal those of MuJoCo's data after the step, with the documented weights."""
    env = gym.make("SimpleQuad-v0", scenario=TILTED)
    forward, lateral, wanted_yaw_rate = command = (0.6, -0.3, 0.8)
    for _, reward, info, data in walk(env, command):
        axes = trunk_axes(data)
        ahead, left, yaw_rate = heading_velocity(data)
        by_hand = {
            "linear_velocity_tracking": 0.012 * np.exp(-np.hypot(forward - ahead, lateral - left) / 0.25),
            "yaw_rate_tracking": 0.008 * np.exp(-abs(wanted_yaw_rate - yaw_rate) / 0.25),
            "tilt": -0.005 * (1 - axes[2, 2] ** 2),
            "vertical_velocity": -0.005 * data.qvel[2] ** 2,
            "roll_pitch_rate": -0.0002 * (data.qvel[3:5] ** 2).sum(),
        }
        for name, value in by_hand.items():
            assert info[f"reward_{name}"] == pytest.approx(value, abs=1e-9), name
        terms = [value for key, value in info.items() if key.startswith("reward_")]
        assert reward == pytest.approx(sum(terms), abs=1e-12)


def check_a_trot_turns_and_sidesteps_to_the_left_for_positive_commands() -> None:
    """A positive lateral command goes to the trunk's left; a positive yaw rate is anticlockwise seen from above."""
    for command in ((0.0, 0.4, 0.0), (0.0, 0.0, 0.8)):
        env = gym.make("SimpleQuad-v0")
        policy = policies.make("trot")
        policy.reset()
        observation, _ = env.reset(seed=0, options={"command": command})
        before = env.unwrapped.data
        for _ in range(150):
            observation, *_ = env.step(policy.act(observation))
        after = env.unwrapped.data
        moved = after.body("base_link").xpos[:2] - before.body("base_link").xpos[:2]
        nose = [trunk_axes(data)[:2, 0] for data in (before, after)]
        turned = np.arctan2(nose[0][0] * nose[1][1] - nose[0][1] * nose[1][0], nose[0] @ nose[1])
        if command[1]:
            assert np.array((-nose[0][1], nose[0][0])) @ moved > 0.2
        else:
            assert turned > 0.5


def tracking_negated(patch: pytest.MonkeyPatch) -> None:
    true_term = rewards.TERMS["reward_linear_velocity_tracking"]
    patch.setitem(rewards.TERMS, "reward_linear_velocity_tracking", lambda state: -true_term(state))


def command_turned(index: int) -> Plant:
    """Return a fault: policies observe an entry of the command with the opposite sign."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_act = Policy.act
        place = quad_env.OBSERVATION["command"].start + index

        def faulty(self: Policy, observation: np.ndarray) -> np.ndarray:
            turned = np.array(observation)
            turned[..., place] *= -1
            return true_act(self, turned)

        patch.setattr(Policy, "act", faulty)

    return plant


def state_with(change: Callable[[QuadState], QuadState]) -> Plant:
    """Return a fault: every reading of the simulation passes through `change`."""
    true_state = Simulation.state

    def faulty(self: Simulation, *args: Any) -> QuadState:
        return change(true_state(self, *args))

    return lambda patch: patch.setattr(Simulation, "state", faulty)


def world_for_heading_frame(patch: pytest.MonkeyPatch) -> None:
    def faulty(rotation, linear_world, angular_body):
        yaw_rate = sum(axis * rate for axis, rate in zip(rotation[2], angular_body, strict=True))
        return linear_world[0], linear_world[1], yaw_rate

    patch.setattr(simulation, "heading_velocity", faulty)


def roll_for_pitch_in_gravity(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(QuadState, "projected_gravity", property(lambda self: tuple(-self.rotation[2][i] for i in (1, 0, 2))))


def swapped(columns: Components, first: int, second: int) -> Components:
    out = list(columns)
    out[first], out[second] = columns[second], columns[first]
    return tuple(out)


FR_THIGH, HL_THIGH = quad_env.JOINT_NAMES.index("fr_thigh_joint"), quad_env.JOINT_NAMES.index("hl_thigh_joint")

two_joints_swapped_in_readings = state_with(
    lambda s: s._replace(joint_position=swapped(s.joint_position, FR_THIGH, HL_THIGH))
)


def two_joints_swapped_in_targets(patch: pytest.MonkeyPatch) -> None:
    true_step = Simulation.step

    def faulty(self: Simulation, action: np.ndarray, *args: Any, **kwargs: Any) -> Any:
        return true_step(self, np.transpose(swapped(action.T, FR_THIGH, HL_THIGH)), *args, **kwargs)

    patch.setattr(Simulation, "step", faulty)


def time_out_counted_as_fall(patch: pytest.MonkeyPatch) -> None:
    true_step = SimpleQuadVectorEnv.step

    def faulty(self: SimpleQuadVectorEnv, actions: np.ndarray) -> Any:
        observation, reward, terminated, truncated, infos = true_step(self, actions)
        infos["fall"] = np.where(truncated, 1, infos["fall"]).astype(np.int8)
        return observation, reward, terminated | truncated, truncated, infos

    patch.setattr(SimpleQuadVectorEnv, "step", faulty)


def evaluation_draws_training_seeds(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(cells, "episode_seeds", lambda _, seed, count: seeding.episode_seeds("training", seed, count))


FAULTS: Faults = {
    "world for heading frame": (world_for_heading_frame, check_readings_are_mujocos_of_this_step),
    "roll for pitch": (roll_for_pitch_in_gravity, check_readings_are_mujocos_of_this_step),
    "two joints swapped in the readings": (two_joints_swapped_in_readings, check_readings_are_mujocos_of_this_step),
    "two joints swapped in the targets": (two_joints_swapped_in_targets, check_joints_move_when_their_own_target_does),
    "a one-step-old reading": (one_call_old(Simulation, "state"), check_readings_are_mujocos_of_this_step),
    "time-out counted as fall": (time_out_counted_as_fall, check_standing_to_the_time_limit_is_no_fall),
    "evaluation on training seeds": (evaluation_draws_training_seeds, check_evaluation_seeds_are_never_drawn_elsewhere),
    "tracking reward negated": (tracking_negated, check_rewards_are_their_terms_of_this_step),
    "lateral command with the other sign": (
        command_turned(1),
        check_a_trot_turns_and_sidesteps_to_the_left_for_positive_commands,
    ),
    "yaw rate command with the other sign": (
        command_turned(2),
        check_a_trot_turns_and_sidesteps_to_the_left_for_positive_commands,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
