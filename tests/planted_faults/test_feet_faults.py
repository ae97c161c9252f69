"""Faults of the feet's readings, planted into the real code: each must make a named check fail.

Checks use the state that reward terms get.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import policies
import quad_env
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import footsteps
from quad_env.physics.footsteps import FootContactTracker
from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests, one_call_old

LEGS = len(SIMPLE_QUAD.leg_names)


class Walk:
    """Trotting robots, and the swing times that reward terms get in each step, (n, 4)."""

    def __init__(self, num_envs: int, scenario: Any = "flat", **options: Any) -> None:
        config = quad_env.TaskConfig(reward_weights=quad_env.RewardWeights(foot_air_time=1.0, touchdown_speed=-1.0))
        self.env = SimpleQuadVectorEnv(num_envs, scenario, nthread=1, config=config, readings=True, **options)
        self._state = self.env.simulation.state
        self.env.simulation.state = self._watched
        self.policy = policies.make("trot")
        self.policy.reset(num_envs)
        self.observation, _ = self.env.reset(seed=3, options={"command": (0.6, 0.2, 0.5)})

    def _watched(self, *arguments: Any) -> Any:
        state = self._state(*arguments)
        self._shown, self.speeds = np.transpose(state.swing_time), np.transpose(state.touchdown_speed)
        return state

    def heights(self) -> np.ndarray:
        """Return the foot heights after the last physics step, (n, 4), m."""
        simulation = self.env.simulation
        return simulation.batch.bind("site_xpos")[:, simulation._feet, 2].copy()

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Return contacts of the last substep, which `test_readings` compares with MuJoCo's list, and swing times."""
        self.observation, *_, infos = self.env.step(self.policy.act(self.observation))
        return infos["foot_contact"], self._shown


def check_swings_are_counted_by_their_steps_in_the_air() -> None:
    """Swing times equal those from each foot's contacts, step by step; the first robot is reset once."""
    walk, period = Walk(3, autoreset_mode="DISABLED"), 0.01
    air, swings, bounces = np.zeros((3, LEGS), int), 0, 0
    for step in range(150):
        if step == 75:
            assert (air[0] > 2).any(), "feet must be in the air where they are put down"
            walk.env.reset(options={"reset_mask": np.arange(3) == 0, "command": (0.6, 0.2, 0.5)})
            air[0] = 0
        contact, shown = walk.step()
        for robot, leg in np.ndindex(3, LEGS):
            down, steps = contact[robot, leg], air[robot, leg]
            landed = down and steps > 1
            air[robot, leg] = 0 if down else steps + 1
            assert shown[robot, leg] == pytest.approx(period * steps if landed else 0.0)
            swings, bounces = swings + landed, bounces + (down and steps == 1)
    assert swings > 30
    assert bounces > 3


def check_a_touchdown_s_speed_is_that_of_the_step_before_it() -> None:
    """The speed equals that of the foot heights before; a foot is slow after its landing."""
    walk, touchdowns = Walk(3), []
    heights = [walk.heights()]
    for _ in range(100):
        _, shown = walk.step()
        heights.append(walk.heights())
        if len(heights) > 3:
            sinking = np.maximum(heights[-3] - heights[-2], 0.0) / 0.01
            np.testing.assert_allclose(walk.speeds, np.where(shown > 0.0, sinking, 0.0), atol=1e-12)
            touchdowns += walk.speeds[shown > 0.0].tolist()
    assert len(touchdowns) > 30
    assert max(touchdowns) > 0.2


def of_the_landing(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: speeds are those of the step in which the ground stops the foot."""
    true_update = FootContactTracker.update

    def update(self: FootContactTracker, ids: Any) -> None:
        sinking = self._position[ids][..., 2] - self._foot_positions(ids)[..., 2]
        self._descent_speed[ids] = np.maximum(sinking, 0.0) / self._period
        true_update(self, ids)

    patch.setattr(FootContactTracker, "update", update)


def bounces_counted(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(footsteps, "MAX_BOUNCE_STEPS", 0)


def begun(change: Callable[[Any], Any]) -> Plant:
    """Return a fault: swing times are reset for `change` of the robots."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_begin = FootContactTracker.reset
        patch.setattr(FootContactTracker, "reset", lambda self, ids: true_begin(self, change(ids)))

    return plant


FAULTS: Faults = {
    "swings of a step ago": (one_call_old(Simulation, "state"), check_swings_are_counted_by_their_steps_in_the_air),
    "speeds of a step ago": (
        one_call_old(Simulation, "state"),
        check_a_touchdown_s_speed_is_that_of_the_step_before_it,
    ),
    "speeds of the landing": (of_the_landing, check_a_touchdown_s_speed_is_that_of_the_step_before_it),
    "swings go on": (begun(lambda ids: ids[:0]), check_swings_are_counted_by_their_steps_in_the_air),
    "everybody's swings begin": (begun(lambda _: slice(None)), check_swings_are_counted_by_their_steps_in_the_air),
    "bounces are swings": (bounces_counted, check_swings_are_counted_by_their_steps_in_the_air),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
