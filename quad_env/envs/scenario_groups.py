"""The vector environment of several scenarios: groups of robots, each with its own scenario."""

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import partial
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from quad_env.columns import Array, Mask
from quad_env.envs import arguments
from quad_env.envs.attributes import check_settable
from quad_env.envs.base import EnvKwargs, EnvOptions, make_robot
from quad_env.envs.combined_env import CombinedVectorEnv
from quad_env.envs.vector_env import RENDER_MODES, Infos, Observation, SimpleQuadVectorEnv
from quad_env.files.text import brief
from quad_env.scenarios.allocation import allocate_robots
from quad_env.scenarios.scenario import Scenario

SHARE_TOLERANCE = 1e-6
"""Largest difference between 1 and the sum of the shares of all scenarios; it allows for rounded shares."""


class ScenarioGroupsVectorEnv(CombinedVectorEnv):
    """Batch of n SimpleQuad robots in groups, one for each of s scenarios; made by `gym.make_vec`.

    The first robots have the first scenario, the next robots the second one, and so on. A group gives the same
    numbers, bit for bit, as `SimpleQuadVectorEnv` of its scenario alone with the same seeds. An info that only some
    scenarios have, such as a sensor reading, is zero for the other robots, and its mask `_<key>` is False for them.

    All arguments except `scenario` hold for all groups, and `SimpleQuadVectorEnv` describes them. ValueError is raised
    for an invalid argument.

    Args:
        num_envs: Number of robots. For a list of scenarios, a multiple of its length.
        scenario: Scenarios: names, or `quad_env.Scenario`. A list gives equal groups, and a repeated scenario gets more
            robots. A dictionary gives the share of the robots of each scenario; see `make_vector_env`.
        nthread: Number of simulation threads; the results do not depend on this number.
        autoreset_mode: An `AutoresetMode` or its name, `NEXT_STEP`, `SAME_STEP` or `DISABLED`.
        max_episode_steps: Time limit in control steps; None or -1 for no limit.
        terminate_on_fall: True if a fall ends the episode.
        render_mode: None, or "rgb_array"; `render` then returns one frame per robot.
        readings: True to add the measurements of `quad_env.task.readings` to the infos.
        **parts: Keyword arguments that configure the robot and the task. Servo gains that differ between robots have a
            row for each of the n robots.

    Attributes:
        batches: Vector environment of each group.
        scenario_ids: Index of each robot's scenario in `scenarios`, (n,).
    """

    SETTABLE: ClassVar = SimpleQuadVectorEnv.SETTABLE
    _made = False
    """True after the constructor has finished; only then, `__setattr__` checks assignments."""

    def __init__(
        self,
        num_envs: int,
        scenario: Sequence[str | Scenario] | Mapping[str | Scenario, float],
        nthread: int = 2,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = 1000,
        terminate_on_fall: bool = True,
        render_mode: str | None = None,
        readings: bool = False,
        **parts: Unpack[EnvKwargs],
    ) -> None:
        sizes = _group_sizes(num_envs, scenario)
        options = EnvOptions(**parts)
        robot, gains = make_robot(options.robot, options.servo, num_envs)
        make = partial(
            SimpleQuadVectorEnv,
            nthread=nthread,
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            terminate_on_fall=terminate_on_fall,
            render_mode=render_mode,
            readings=readings,
            **parts,
        )
        batches = []
        start = 0
        for entry, size in zip(scenario, sizes, strict=True):
            rows = slice(start, start + size)
            servo = options.servo if gains is None else tuple(gains[:, rows])
            batches.append(make(size, scenario=entry, servo=servo))
            start += size
        super().__init__(batches)
        self.robot = robot
        self.config = batches[0].config
        self.autoreset_mode = batches[0].autoreset_mode
        self.observation_table = batches[0].observation_table
        self.scenario_ids = np.repeat(np.arange(len(batches)), sizes)
        self._made = True

    def __setattr__(self, name: str, value: Any) -> None:
        """Set the attribute `name` to `value`; raise AttributeError if the assignment would have no effect."""
        if name[0] != "_" and self._made:
            check_settable(self, name, value, EnvKwargs.__annotations__)
        object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        args, kwargs = self._arguments
        state = {"spec": deepcopy(self.spec), "batches": [deepcopy(batch.__reduce__()[2]) for batch in self.batches]}
        return partial(type(self), *args, **kwargs), (), state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.spec = state["spec"]
        for batch, batch_state in zip(self.batches, state["batches"], strict=True):
            vars(batch).update(batch_state)

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """Scenario of each group."""
        return tuple(batch.scenario for batch in self.batches)

    @property
    def severity(self) -> Array:
        """Severity of each robot's scenario, (n,); `reset` changes it."""
        return np.concatenate([batch.severity for batch in self.batches])

    @property
    def observes_true_state(self) -> bool:
        """True if the observation of every group is the true state, without noise and delay."""
        return all(batch.observes_true_state for batch in self.batches)

    @property
    def terminate_on_fall(self) -> bool:
        """True if a fall ends the episode."""
        return self.batches[0].terminate_on_fall

    @terminate_on_fall.setter
    def terminate_on_fall(self, value: bool) -> None:
        for batch in self.batches:
            batch.terminate_on_fall = value

    @property
    def max_episode_steps(self) -> int | None:
        """Time limit in control steps; None for no limit."""
        return self.batches[0].max_episode_steps

    @max_episode_steps.setter
    def max_episode_steps(self, value: int | None) -> None:
        for batch in self.batches:
            batch.max_episode_steps = value

    @property
    def render_mode(self) -> str | None:
        """Mode of `render`: "rgb_array", or None."""
        return self.batches[0].render_mode

    @render_mode.setter
    def render_mode(self, value: str | None) -> None:
        for batch in self.batches:
            batch.render_mode = value

    def step(self, actions: NDArray[np.floating[Any]]) -> tuple[Observation, Array, Mask, Mask, Infos]:
        """Advance by one control period of `dt` seconds, see `SimpleQuadVectorEnv.step`.

        Args:
            actions: Joint targets, (n, 12), rad; targets beyond the joint limits are clipped.

        Returns:
            The results of `SimpleQuadVectorEnv.step` for all n robots.

        Raises:
            ResetNeeded: An env was never reset.
        """
        if not all(batch.has_started for batch in self.batches):
            raise ResetNeeded("reset the environments before the first step")
        shape = (self.num_envs, self.robot.num_joints)
        targets = arguments.check_joint_targets(actions, shape, self.robot.joint_lower, self.robot.joint_upper)
        return super().step(targets)

    def steer(self, command: ArrayLike) -> None:
        """Set the velocity command that robots track until the next reset, see `SimpleQuadVectorEnv.steer`.

        Args:
            command: Forward and lateral velocity, heading frame, m/s, and yaw rate, rad/s, (3,) or (n, 3).
        """
        commands = arguments.check_commands(command, self.num_envs, "command")
        for batch, part in zip(self.batches, self._parts, strict=True):
            batch.steer(commands[part])

    def push(self, force: ArrayLike, duration: float) -> None:
        """Apply a horizontal force to the trunks, see `SimpleQuadVectorEnv.push`.

        Args:
            force: Force on the trunk, world frame, (2,) or (n, 2), N.
            duration: Duration of the push, s.
        """
        forces = arguments.check_rows(force, (self.num_envs, 2), "force")
        for batch, part in zip(self.batches, self._parts, strict=True):
            batch.push(forces[part], duration)

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """Return an RGB image of each robot, n times (480, 640, 3) uint8; None if `render_mode` is None."""
        if self.render_mode is None:
            arguments.warn_no_render_mode(RENDER_MODES)
            return None
        return tuple(frame for batch in self.batches for frame in batch.render() or ())


def make_vector_env(
    num_envs: int = 1, scenarios: Mapping[str | Scenario, float] | None = None, **options: Any
) -> SimpleQuadVectorEnv | ScenarioGroupsVectorEnv:
    """Make the vector environment of one scenario, or of several scenarios; the entry point of `gym.make_vec`.

    Args:
        num_envs: Number of robots.
        scenarios: Scenario -> share of the robots, at most one robot more or less; each scenario has a robot or more.
            The shares are positive and sum to 1. None if `scenario` is given.
        **options: Further arguments of `SimpleQuadVectorEnv`. `scenario` can also be a list or tuple with the scenario
            of each of equal groups of robots.

    Returns:
        `SimpleQuadVectorEnv` for one scenario, `ScenarioGroupsVectorEnv` for several.

    Raises:
        ValueError: An argument is invalid, or both `scenario` and `scenarios` are given.
    """
    if scenarios is not None:
        if "scenario" in options:
            raise ValueError("scenarios: scenario is given too; valid: one of scenario=... and scenarios={...: share}")
        return ScenarioGroupsVectorEnv(num_envs, _check_shares(scenarios), **options)
    if isinstance(options.get("scenario"), list | tuple):
        return ScenarioGroupsVectorEnv(num_envs, **options)
    return SimpleQuadVectorEnv(num_envs, **options)


def _check_shares(scenarios: Any) -> Mapping[str | Scenario, float]:
    """Check the shares of the robots of all scenarios, and return them; raise ValueError if they are invalid."""
    if not isinstance(scenarios, Mapping) or not scenarios:
        raise ValueError(f"scenarios: no share of any scenario, got {brief(scenarios)}; valid: {{'flat': 0.5, ...}}")
    for scenario, share in scenarios.items():
        is_number = isinstance(share, int | float | np.integer | np.floating) and not isinstance(share, bool)
        if not is_number or not 0 < share < math.inf:
            name = scenario.name if isinstance(scenario, Scenario) else scenario
            raise ValueError(f"scenarios: invalid share of {name!r}, got {brief(share)}; valid: positive numbers")
    total = math.fsum(scenarios.values())
    if abs(total - 1) > SHARE_TOLERANCE:
        raise ValueError(f"scenarios: the shares sum to {total:.9g}; valid: a sum of 1")
    return scenarios


def _group_sizes(num_envs: Any, scenario: Sequence[Any] | Mapping[Any, float]) -> list[int]:
    """Return the number of robots of each group; raise ValueError if a group would have no robots or a part of one."""
    count = len(scenario)
    if not count:
        raise ValueError("scenario: an empty list; valid: one scenario, or a list with a scenario for each group")
    robots = arguments.check_count("num_envs", num_envs)
    if isinstance(scenario, Mapping):
        if count > robots:
            raise ValueError(f"num_envs: {count} scenarios need a robot each, got {robots}; valid: at least {count}")
        return allocate_robots(list(scenario.values()), robots, min_count=1)
    if robots % count:
        raise ValueError(f"num_envs: {count} scenarios need equal groups, got {num_envs}; valid: a multiple of {count}")
    return [robots // count] * count
