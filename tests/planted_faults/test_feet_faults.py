"""Faults of the feet's readings, planted into the real code: each must turn a named check red.

What is checked is what reward terms are shown.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

import policies
import quad_env
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import footsteps
from quad_env.physics.footsteps import Footsteps
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests, one_call_old

SPINNING = replace(quad_env.SCENARIOS["rough"], start=quad_env.StartNoise(tilt=0.3, angular_velocity=3.0))
LEGS = len(SIMPLE_QUAD.leg_names)
Readings = dict[str, np.ndarray]


class Walk:
    """Robots that trot, and what reward terms are shown of their feet at each step: name -> (n, 4, …)."""

    def __init__(self, num_envs: int, scenario: Any = "flat", **options: Any) -> None:
        config = quad_env.TaskConfig(reward_weights=quad_env.RewardWeights(foot_slip=-0.1))
        self.env = SimpleQuadVectorEnv(num_envs, scenario, nthread=1, config=config, readings=True, **options)
        self._state = self.env.simulation.state
        self.env.simulation.state = self._watched
        self.policy = policies.make("trot")
        self.policy.reset(num_envs)
        self.observation, _ = self.env.reset(seed=3, options={"command": (0.6, 0.2, 0.5)})

    def _watched(self, *arguments: Any) -> Any:
        state = self._state(*arguments)
        self._shown = {name: np.moveaxis(np.array(value), -1, 0).copy() for name, value in state.feet._asdict().items()}
        return state

    def step(self) -> Readings:
        """Contacts are those of the last substep, which `test_readings` holds against MuJoCo's own list."""
        self.observation, *_, infos = self.env.step(self.policy.act(self.observation))
        np.testing.assert_array_equal(self._shown["contact"], infos["foot_contact"])
        return self._shown


def check_feet_are_where_and_as_fast_as_mujoco_says() -> None:
    """By its own kinematics of the state after the step, leg by leg; on rough ground, tilted and spinning."""
    walk = Walk(2, SPINNING, terminate_on_fall=False, sensors="typical")
    for step in range(40):
        shown = walk.step()
        if step % 4:
            continue
        simulation, velocity = walk.env.simulation, np.zeros(6)
        data = simulation.snapshot(1)
        for leg, name in enumerate(SIMPLE_QUAD.leg_names):
            foot = data.site(f"{name}_foot")
            mujoco.mj_objectVelocity(simulation.model, data, mujoco.mjtObj.mjOBJ_SITE, foot.id, velocity, 0)
            height = foot.xpos[2] - simulation.terrain.height(*foot.xpos[:2]) - SIMPLE_QUAD.foot_radius
            np.testing.assert_allclose(shown["position"][1, leg], foot.xpos, atol=1e-12)
            np.testing.assert_allclose(shown["velocity"][1, leg], velocity[3:], atol=1e-10)
            np.testing.assert_allclose(shown["height"][1, leg], height, atol=1e-12)


def check_swings_are_counted_by_their_steps_in_the_air() -> None:
    """Against an account of each foot's contacts and velocities, step by step; the first robot is restarted once."""
    walk, period = Walk(3, autoreset_mode="DISABLED"), 0.01
    air, falling = np.zeros((3, LEGS), int), np.zeros((3, LEGS))
    swings, bounces = 0, 0
    for step in range(150):
        if step == 75:
            assert (air[0] > 2).any(), "feet must be in the air where they are put down"
            walk.env.reset(options={"reset_mask": np.arange(3) == 0, "command": (0.6, 0.2, 0.5)})
            air[0] = 0
        shown = walk.step()
        for robot, leg in np.ndindex(3, LEGS):
            down, steps = shown["contact"][robot, leg], air[robot, leg]
            landed = down and steps > 1
            air[robot, leg] = 0 if down else steps + 1
            wanted = {
                "air_time": period * air[robot, leg],
                "swing_time": period * steps if landed else 0.0,
                "impact_speed": max(falling[robot, leg], 0.0) if landed else 0.0,
            }
            assert {name: shown[name][robot, leg] for name in wanted} == pytest.approx(wanted)
            swings, bounces = swings + landed, bounces + (down and steps == 1)
        falling = -shown["velocity"][..., 2]
    assert swings > 30
    assert bounces > 3


def velocity_in_base_frame(patch: pytest.MonkeyPatch) -> None:
    true_motion = footsteps.feet_motion_in_world

    def faulty(robot: Any, rotation: np.ndarray, *args: Any) -> tuple[np.ndarray, np.ndarray]:
        upright = np.broadcast_to(np.eye(3), rotation.shape)
        return true_motion(robot, rotation, *args)[0], true_motion(robot, upright, *args)[1]

    patch.setattr(footsteps, "feet_motion_in_world", faulty)


def bounces_counted(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(footsteps, "BOUNCE", 0)


def impact_after_the_touch_down(patch: pytest.MonkeyPatch) -> None:
    true_advance = Footsteps.advance

    def faulty(self: Footsteps, ids: Any) -> None:
        self._look(ids)
        true_advance(self, ids)

    patch.setattr(Footsteps, "advance", faulty)


def begun(change: Callable[[Any], Any]) -> Plant:
    """Swings begin anew of `change` of the robots that should."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_begin = Footsteps.begin
        patch.setattr(Footsteps, "begin", lambda self, ids: true_begin(self, change(ids)))

    return plant


FAULTS: Faults = {
    "velocity in the base frame": (velocity_in_base_frame, check_feet_are_where_and_as_fast_as_mujoco_says),
    "feet of a step ago": (one_call_old(Footsteps, "feet"), check_feet_are_where_and_as_fast_as_mujoco_says),
    "swings go on": (begun(lambda ids: ids[:0]), check_swings_are_counted_by_their_steps_in_the_air),
    "everybody's swings begin": (begun(lambda _: slice(None)), check_swings_are_counted_by_their_steps_in_the_air),
    "bounces are swings": (bounces_counted, check_swings_are_counted_by_their_steps_in_the_air),
    "impact speed after the touch-down": (
        impact_after_the_touch_down,
        check_swings_are_counted_by_their_steps_in_the_air,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
