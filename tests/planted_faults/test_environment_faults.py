"""Faults that would spoil every figure, planted into the real code: each must turn a named check red.

A check asks the environment or the evaluator for something that physics, geometry or the contract settles without
them. It passes on the code as it is, and fails with the fault.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import policies
import quad_env
from evaluate.measures import metrics
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import evaluation_seeds
from policies.base import Policy
from quad_env import seeding
from quad_env.columns import Vector
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task import rewards
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests

FORWARD = {"command": (0.5, 0.0, 0.0)}
TILTED = replace(quad_env.SCENARIOS["flat"], start=quad_env.StartNoise(tilt=0.4))


def walk(env: gym.Env, seed: int, steps: int):
    """Observation, info and a snapshot of MuJoCo's own data after each step of the trot."""
    policy = policies.make("trot")
    policy.reset()
    observation, _ = env.reset(seed=seed, options=FORWARD)
    for _ in range(steps):
        observation, _, _, _, info = env.step(policy.act(observation))
        yield observation, info, env.unwrapped.data


def part(observation: np.ndarray, name: str) -> np.ndarray:
    return observation[quad_env.OBSERVATION[name]]


def trunk_axes(data: mujoco.MjData) -> np.ndarray:
    """Columns: the trunk's x, y and z axes in the world, by MuJoCo's own kinematics."""
    return data.body("base_link").xmat.reshape(3, 3)


def seed_facing_sideways(env: gym.Env) -> int:
    """A start within 30° of facing along the world's y axis."""
    for seed in range(100):
        env.reset(seed=seed, options=FORWARD)
        if abs(trunk_axes(env.unwrapped.data)[1, 0]) > np.cos(np.deg2rad(30)):
            return seed
    raise AssertionError("100 starts and none faces sideways")


def check_heading_velocity_is_the_displacement_seen_along_the_nose() -> None:
    """Facing along y, `heading_velocity` is the trunk's displacement over time, turned into the trunk's heading."""
    env = gym.make("SimpleQuad-v0")
    seed = seed_facing_sideways(env)
    displaced, reported, previous = np.zeros(2), np.zeros(2), None
    for _, info, data in walk(env, seed, 200):
        position, nose = data.body("base_link").xpos[:2].copy(), trunk_axes(data)[:2, 0]
        if previous is not None:
            along, left = nose / np.linalg.norm(nose), np.array((-nose[1], nose[0])) / np.linalg.norm(nose)
            displaced += (along @ (position - previous), left @ (position - previous))
            reported += info["heading_velocity"][:2] * env.unwrapped.dt
        previous = position
    assert np.linalg.norm(displaced) > 0.3, "the robot must have walked for this to show anything"
    np.testing.assert_allclose(reported, displaced, atol=0.03)


def check_joints_move_when_their_own_target_does() -> None:
    """A target that differs from the home pose in one entry moves the joint of that name, most of all."""
    env = gym.make("SimpleQuad-v0", terminate_on_fall=False)
    for index, name in enumerate(quad_env.JOINT_NAMES):
        target = SIMPLE_QUAD.home_pose.astype(np.float32)
        target[index] += 0.3
        env.reset(seed=0, options=FORWARD)
        for _ in range(10):
            env.step(target)
        data = env.unwrapped.data
        moved = np.array([data.joint(joint).qpos[0] for joint in quad_env.JOINT_NAMES]) - SIMPLE_QUAD.home_pose
        assert quad_env.JOINT_NAMES[np.argmax(moved)] == name


def check_readings_are_mujocos_of_this_step() -> None:
    """Frames, axes and joints by their names: every reading is the one worked out from MuJoCo's data."""
    env = gym.make("SimpleQuad-v0")
    for observation, info, data in walk(env, 0, 30):
        axes = trunk_axes(data)
        np.testing.assert_allclose(part(observation, "linear_velocity"), axes.T @ data.qvel[:3], atol=1e-5)
        np.testing.assert_allclose(part(observation, "angular_velocity"), data.qvel[3:6], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(part(observation, "projected_gravity"), -axes[2], atol=1e-6)
        np.testing.assert_allclose(info["heading_velocity"][2], axes[2] @ data.qvel[3:6], atol=1e-5)
        angles = [data.joint(name).qpos[0] for name in quad_env.JOINT_NAMES]
        rates = [data.joint(name).qvel[0] for name in quad_env.JOINT_NAMES]
        np.testing.assert_allclose(part(observation, "joint_position") + SIMPLE_QUAD.home_pose, angles, atol=1e-5)
        np.testing.assert_allclose(part(observation, "joint_velocity"), rates, rtol=1e-5, atol=1e-5)


def check_standing_to_the_time_limit_is_no_fall() -> None:
    """A robot that stands until the time is up has not fallen, and is billed nothing for it."""
    episodes = rollout.run(policies.make("stand"), "flat", evaluation_seeds(0, 3), steps=150)
    measures = metrics.measure(episodes)
    assert not measures.fell.any()
    assert np.isnan(measures.fall_time).all()
    np.testing.assert_array_equal(measures.velocity_error, measures.velocity_error_upright)


def check_evaluation_seeds_are_never_drawn_elsewhere() -> None:
    """No seed of the evaluator belongs to another purpose, whatever the two command lines' --seed say."""
    evaluated = {int(seed) for run in range(20) for seed in evaluation_seeds(run, 512)}
    for purpose in set(seeding.PURPOSES) - {"evaluation"}:
        drawn = {int(seed) for run in range(20) for seed in seeding.episode_seeds(purpose, run, 512)}
        assert not evaluated & drawn, purpose
    assert min(evaluated) >= 2**48, "small seeds are the ones that people type"


def check_rewards_are_their_terms_of_this_step() -> None:
    """Tracking, tilt and vertical velocity are those of MuJoCo's data after the step, weighted as documented."""
    env = gym.make("SimpleQuad-v0", scenario=TILTED)
    command = np.array((0.6, -0.3, 0.8))
    policy = policies.make("trot")
    policy.reset()
    observation, _ = env.reset(seed=1, options={"command": command})
    for _ in range(30):
        observation, reward, _, _, info = env.step(policy.act(observation))
        data = env.unwrapped.data
        axes = trunk_axes(data)
        nose = axes[:2, 0] / np.linalg.norm(axes[:2, 0])
        velocity = np.array((nose @ data.qvel[:2], nose[0] * data.qvel[1] - nose[1] * data.qvel[0]))
        yaw_rate = axes[2] @ data.qvel[3:6]
        by_hand = {
            "linear_velocity_tracking": 0.012 * np.exp(-np.linalg.norm(command[:2] - velocity) / 0.25),
            "yaw_rate_tracking": 0.008 * np.exp(-abs(command[2] - yaw_rate) / 0.25),
            "tilt": -0.005 * (1 - axes[2, 2] ** 2),
            "vertical_velocity": -0.005 * data.qvel[2] ** 2,
            "roll_pitch_rate": -0.0002 * (data.qvel[3:5] ** 2).sum(),
        }
        for name, value in by_hand.items():
            assert info[f"reward_{name}"] == pytest.approx(value, abs=1e-9), name
        terms = [value for key, value in info.items() if key.startswith("reward_")]
        assert reward == pytest.approx(sum(terms), abs=1e-12)


def check_a_fall_is_paid_for_once_with_one() -> None:
    """The step in which a robot falls costs 1 more than its other terms, and no step before it costs that."""
    env = gym.make("SimpleQuad-v0")
    env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    folded = np.tile((0.0, 1.5, 0.0), 4).astype(np.float32)  # straight legs, far forward: the trunk comes down
    paid = []
    for _ in range(200):
        _, _, fell, _, info = env.step(folded)
        paid.append(info["reward_fall"])
        if fell:
            break
    assert fell
    assert paid == [0.0] * (len(paid) - 1) + [-1.0]


def check_a_trot_turns_and_sidesteps_to_the_left_for_positive_commands() -> None:
    """Positive lateral command: along the trunk's own left; positive yaw rate: anticlockwise seen from above."""
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


def reward_term(name: str, change: Callable[[Any], Any]) -> Plant:
    """The term is `change` of itself."""
    key = f"reward_{name}"
    true_term = rewards.TERMS[key]
    return lambda patch: patch.setitem(rewards.TERMS, key, lambda state: change(true_term)(state))


def weight_of(name: str, value: float) -> Plant:
    """Both environments weigh that term so, whatever the configuration says."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setattr(
            "quad_env.envs.base.step_weights",
            lambda weights, dt, own: rewards.step_weights(replace(weights, **{name: value}), dt, own),
        )

    return plant


def forward_for_yaw(term: Any) -> Any:
    """The term of a state whose commanded yaw rate is read at the place of the forward velocity."""
    return lambda state: term(state._replace(command=(state.command[0], state.command[1], state.command[0])))


def command_turned(index: int) -> Plant:
    """Policies see that entry of the command with the other sign."""

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
    """Every reading of the simulation passes through `change`."""
    true_readings = Simulation._readings

    def faulty(self: Simulation, *args: Any) -> QuadState:
        return change(true_readings(self, *args))

    return lambda patch: patch.setattr(Simulation, "_readings", faulty)


def world_for_heading_frame(patch: pytest.MonkeyPatch) -> None:
    def faulty(rotation, linear_world, angular_body):
        yaw_rate = sum(axis * rate for axis, rate in zip(rotation[2], angular_body, strict=True))
        return linear_world[0], linear_world[1], yaw_rate

    patch.setattr("quad_env.physics.simulation.heading_velocity", faulty)


def roll_for_pitch_in_gravity(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(QuadState, "projected_gravity", property(lambda self: tuple(-self.rotation[2][i] for i in (1, 0, 2))))


def swapped(columns: Vector, first: int, second: int) -> Vector:
    out = list(columns)
    out[first], out[second] = columns[second], columns[first]
    return tuple(out)


FR_THIGH, HL_THIGH = quad_env.JOINT_NAMES.index("fr_thigh_joint"), quad_env.JOINT_NAMES.index("hl_thigh_joint")

roll_rate_for_pitch_rate = state_with(lambda s: s._replace(angular_velocity=swapped(s.angular_velocity, 0, 1)))
two_joints_swapped_in_readings = state_with(
    lambda s: s._replace(joint_position=swapped(s.joint_position, FR_THIGH, HL_THIGH))
)


def two_joints_swapped_in_targets(patch: pytest.MonkeyPatch) -> None:
    true_step = Simulation.step

    def faulty(self: Simulation, action: np.ndarray, *args: Any, **kwargs: Any) -> Any:
        return true_step(self, np.transpose(swapped(action.T, FR_THIGH, HL_THIGH)), *args, **kwargs)

    patch.setattr(Simulation, "step", faulty)


def reading_one_step_old(patch: pytest.MonkeyPatch) -> None:
    last: dict[int, QuadState] = {}

    def stale(self: Simulation, *args: Any) -> QuadState:
        now = true_readings(self, *args)
        before = deepcopy(last.get(id(self), now))  # Gymnasium's checker would stop a reading that is handed out twice
        last[id(self)] = now
        return before

    true_readings = Simulation._readings
    patch.setattr(Simulation, "_readings", stale)


def time_out_counted_as_fall(patch: pytest.MonkeyPatch) -> None:
    true_step = SimpleQuadVectorEnv.step

    def faulty(self: SimpleQuadVectorEnv, actions: np.ndarray) -> Any:
        observation, reward, terminated, truncated, infos = true_step(self, actions)
        infos["fall"] = np.where(truncated, 1, infos["fall"]).astype(np.int8)
        return observation, reward, terminated | truncated, truncated, infos

    patch.setattr(SimpleQuadVectorEnv, "step", faulty)


def evaluation_draws_training_seeds(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        "evaluate.rollouts.experiment.episode_seeds",
        lambda _, seed, count: seeding.episode_seeds("training", seed, count),
    )


def purposes_share_their_seeds(patch: pytest.MonkeyPatch) -> None:
    def faulty(purpose: str, seed: int, count: int) -> np.ndarray:
        return np.random.SeedSequence(seed).generate_state(count, np.uint64) >> np.uint64(8)

    patch.setattr("quad_env.seeding.episode_seeds", faulty)
    patch.setattr("evaluate.rollouts.experiment.episode_seeds", faulty)


FAULTS: Faults = {
    "world for heading frame": (
        world_for_heading_frame,
        check_heading_velocity_is_the_displacement_seen_along_the_nose,
    ),
    "roll for pitch": (roll_for_pitch_in_gravity, check_readings_are_mujocos_of_this_step),
    "roll rate for pitch rate": (roll_rate_for_pitch_rate, check_readings_are_mujocos_of_this_step),
    "two joints swapped in the readings": (
        two_joints_swapped_in_readings,
        check_readings_are_mujocos_of_this_step,
    ),
    "two joints swapped in the targets": (two_joints_swapped_in_targets, check_joints_move_when_their_own_target_does),
    "a one-step-old reading": (reading_one_step_old, check_readings_are_mujocos_of_this_step),
    "time-out counted as fall": (time_out_counted_as_fall, check_standing_to_the_time_limit_is_no_fall),
    "evaluation on training seeds": (evaluation_draws_training_seeds, check_evaluation_seeds_are_never_drawn_elsewhere),
    "one family of seeds for every purpose": (
        purposes_share_their_seeds,
        check_evaluation_seeds_are_never_drawn_elsewhere,
    ),
    "tracking reward negated": (
        reward_term("linear_velocity_tracking", lambda term: lambda state: -term(state)),
        check_rewards_are_their_terms_of_this_step,
    ),
    "yaw term reads another index": (
        reward_term("yaw_rate_tracking", forward_for_yaw),
        check_rewards_are_their_terms_of_this_step,
    ),
    "tilt is paid for": (weight_of("tilt", 0.5), check_rewards_are_their_terms_of_this_step),
    "falls are paid for": (weight_of("fall", 1.0), check_a_fall_is_paid_for_once_with_one),
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
