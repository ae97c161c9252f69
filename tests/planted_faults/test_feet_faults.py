"""Faults of the feet's readings, planted into the real code: each must turn a named check red.

What is checked is what a user's own reward term is shown.
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
from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests

SPINNING = replace(quad_env.SCENARIOS["rough"], start=quad_env.StartNoise(tilt=0.3, angular_velocity=3.0))
LEGS = len(SIMPLE_QUAD.leg_names)
Readings = dict[str, np.ndarray]


class Walk:
    """Robots that trot, and what a reward term is shown of their feet at each step: name -> (n, 4, …)."""

    def __init__(self, num_envs: int, scenario: Any = "flat", **options: Any) -> None:
        term = quad_env.RewardTerm("show", self._show, 0.0)
        config = quad_env.TaskConfig(reward_terms=(term,))
        self.env = SimpleQuadVectorEnv(num_envs, scenario, nthread=1, config=config, readings=True, **options)
        self.policy = policies.make("trot")
        self.policy.reset(num_envs)
        self.observation, _ = self.env.reset(seed=3, options={"command": (0.6, 0.2, 0.5)})
        self.infos: dict[str, Any] = {}

    def _show(self, state: Any, feet: Any) -> Any:
        self._shown = {name: np.moveaxis(np.array(value), -1, 0).copy() for name, value in feet._asdict().items()}
        return 0.0 * state.height

    def step(self) -> Readings:
        self.observation, *_, self.infos = self.env.step(self.policy.act(self.observation))
        return self._shown


def check_feet_are_where_and_as_fast_as_mujoco_says() -> None:
    """By its own kinematics of the state after the step, leg by leg; on rough ground, tilted and spinning."""
    walk = Walk(2, SPINNING, terminate_on_fall=False)
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


def check_contacts_are_those_of_the_readings() -> None:
    """Of the last substep, which `test_readings` holds against MuJoCo's own list; a probe looks at a later state."""
    for sensors in ("truth", "typical"):
        walk, seen = Walk(2, sensors=sensors), set()
        for _ in range(60):
            np.testing.assert_array_equal(walk.step()["contact"], walk.infos["foot_contact"])
            seen |= {tuple(feet) for feet in walk.infos["foot_contact"].tolist()}
        assert len(seen) > 6, "several footholds must occur for this to show anything"


def check_swings_are_counted_by_their_steps_in_the_air() -> None:
    """Against an account of each foot's contacts and velocities, step by step."""
    walk, period = Walk(3), 0.01
    air, falling = np.zeros((3, LEGS), int), np.zeros((3, LEGS))
    swings, bounces = 0, 0
    for _ in range(150):
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


def check_only_robots_that_restart_forget_their_swings() -> None:
    """The first of two is restarted; the other's feet are those of a twin that nobody restarts."""
    walk, twin = Walk(2, autoreset_mode="DISABLED"), Walk(2)
    for step in range(60):
        if step == 30:
            first = np.array([True, False])
            walk.env.reset(options={"reset_mask": first, "command": (0.6, 0.2, 0.5)})
        shown, wanted = walk.step(), twin.step()
        for name in shown:
            np.testing.assert_array_equal(shown[name][1], wanted[name][1], err_msg=name)
        if step == 29:
            assert (shown["air_time"][0] > 0.02).any(), "feet must be in the air where they are put down"
        if step == 30:
            assert shown["air_time"][0].max() <= 0.01
            assert not shown["swing_time"][0].any()
            assert not shown["impact_speed"][0].any()


def motion(fault: Callable[..., tuple[np.ndarray, np.ndarray]]) -> Plant:
    """Where feet are and how they move is `fault` of the true function and its arguments."""
    true_motion = footsteps.feet_motion_in_world
    return lambda patch: patch.setattr(footsteps, "feet_motion_in_world", lambda *args: fault(true_motion, *args))


def legs_swapped(true_motion: Callable[..., Any], *args: Any) -> tuple[np.ndarray, np.ndarray]:
    position, velocity = true_motion(*args)
    return position[:, [1, 0, 2, 3]], velocity[:, [1, 0, 2, 3]]


def in_base_frame(true_motion: Callable[..., Any], robot: Any, rotation: np.ndarray, *args: Any) -> Any:
    upright = np.broadcast_to(np.eye(3), rotation.shape)
    return true_motion(robot, rotation, *args)[0], true_motion(robot, upright, *args)[1]


def not_turning(true_motion: Callable[..., Any], robot: Any, rotation: Any, qpos: Any, qvel: np.ndarray) -> Any:
    still = qvel.copy()
    still[:, 3:6] = 0.0
    return true_motion(robot, rotation, qpos, still)


def one_step_old(patch: pytest.MonkeyPatch) -> None:
    """Feet are looked at before the step instead of after it."""

    def faulty(self: Simulation, action: np.ndarray, push: Any, ids: Any = slice(None), received: Any = None) -> None:
        if self._footsteps is not None:
            self._footsteps._look(ids)
        with pytest.MonkeyPatch.context() as inner:
            inner.setattr(Footsteps, "_look", lambda *_: None)
            true_step(self, action, push, ids, received)

    true_step = Simulation.step
    patch.setattr(Simulation, "step", faulty)


def height_above_the_origin(patch: pytest.MonkeyPatch) -> None:
    true_feet = Footsteps.feet
    patch.setattr(
        Footsteps,
        "feet",
        lambda self, columns: (feet := true_feet(self, columns))._replace(
            height=tuple(z - SIMPLE_QUAD.foot_radius for _, _, z in feet.position)
        ),
    )


def advanced_before_the_step(patch: pytest.MonkeyPatch) -> None:
    """Contacts are those of the control step before."""

    def faulty(self: Simulation, action: np.ndarray, push: Any, ids: Any = slice(None), received: Any = None) -> None:
        footsteps_now, self._footsteps = self._footsteps, None
        footsteps_now.advance(ids)
        true_step(self, action, push, ids, received)
        self._footsteps = footsteps_now

    true_step = Simulation.step
    patch.setattr(Simulation, "step", faulty)


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
    "two legs swapped": (motion(legs_swapped), check_feet_are_where_and_as_fast_as_mujoco_says),
    "velocity in the base frame": (motion(in_base_frame), check_feet_are_where_and_as_fast_as_mujoco_says),
    "velocity without the trunk's turning": (motion(not_turning), check_feet_are_where_and_as_fast_as_mujoco_says),
    "feet of a step ago": (one_step_old, check_feet_are_where_and_as_fast_as_mujoco_says),
    "height without the terrain": (height_above_the_origin, check_feet_are_where_and_as_fast_as_mujoco_says),
    "contacts of a step ago": (advanced_before_the_step, check_contacts_are_those_of_the_readings),
    "bounces are swings": (bounces_counted, check_swings_are_counted_by_their_steps_in_the_air),
    "impact speed after the touch-down": (
        impact_after_the_touch_down,
        check_swings_are_counted_by_their_steps_in_the_air,
    ),
    "swings go on": (begun(lambda ids: ids[:0]), check_only_robots_that_restart_forget_their_swings),
    "everybody's swings begin": (begun(lambda _: slice(None)), check_only_robots_that_restart_forget_their_swings),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
