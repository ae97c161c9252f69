"""A single robot or one of a batch, and the effect of an option on a reading of it."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

import quad_env
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import EpisodeStreams

SEED, STEPS, DT = 5, 12, 0.01
"""Seed of the tested robot, number of control steps of a series, and control period, s."""
HOME, FAR = SIMPLE_QUAD.home_pose, tuple(SIMPLE_QUAD.joint_upper)
"""FAR is unreachable for every servo for several steps."""
WAVES = HOME + np.random.default_rng(0).uniform(-0.15, 0.15, (STEPS, 12))
CALM = quad_env.StartNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IDEAL = quad_env.SENSORS["ideal"]
STRAIGHT = quad_env.CommandRanges(zero_fraction=0.0, interval=0.02)
SCAN = quad_env.HeightScan(ahead=1, behind=0, aside=1)


class Robot:
    """A single robot, or the second robot of a batch whose other robots have other actions and are ahead in time.

    It has moved in a previous episode, which must have no effect.
    """

    def __init__(self, alone: bool, reset: Any = None, **options: Any) -> None:
        self.alone, self.row = alone, 0 if alone else 1
        how = {"disable_env_checker": True} if alone else {"num_envs": 2}
        self.env: Any = (gym.make if alone else gym.make_vec)("quad_env:SimpleQuad-v0", **how | options)
        self.base = self.env.unwrapped
        self._keep(*self.env.reset(seed=99))
        for _ in range(2):
            self.step(SIMPLE_QUAD.joint_upper)
        mask = {} if alone else {"reset_mask": np.arange(self.base.num_envs) == 1}
        self._keep(*self.env.reset(seed=SEED - self.row, options=mask | (reset or {})))

    def step(self, action: np.ndarray = HOME) -> None:
        others = np.tile(action + 0.1, (1 if self.alone else self.base.num_envs, 1))
        others[self.row] = action
        seen, self.reward, self.ended, self.cut, infos = self.env.step(action if self.alone else others)
        self._keep(seen, infos)

    def _keep(self, seen: Any, infos: Any) -> None:
        self.seen = self.own(seen)
        self.infos = {key: self.own(value) for key, value in infos.items() if not isinstance(value, dict)}

    def own(self, value: Any) -> Any:
        """Return the value of this robot from a value of the batch."""
        return value if self.alone else value[self.row]

    @property
    def now(self) -> Any:
        """Return the simulation of this robot; the model is its own from now on."""
        return self.base.simulation.snapshot(self.row)

    @property
    def model(self) -> Any:
        return self.base.simulation.model


Reading = Callable[[Robot], Any]


@dataclass(frozen=True)
class Effect:
    """Effect of an option: its value changes a reading to the expected one, with a tolerance `within`."""

    value: Any
    reading: Reading
    expected: Any
    """Expected reading, or a function from the reading at the default value to it."""
    given: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Other arguments that the effect requires."""
    within: float = 1e-5

    def of(self, alone: bool, options: dict[str, Any]) -> Any:
        """Return the reading of a robot that is made with the given options."""
        return self.reading(Robot(alone, **self.given | options))

    def check(self, before: Any, after: Any) -> None:
        expected = self.expected(before) if callable(self.expected) else self.expected
        assert same(after, expected, self.within), (after, expected)
        assert not same(before, expected, self.within), "or this shows nothing"


def same(found: Any, expected: Any, within: float) -> bool:
    found, expected = np.asarray(found), np.asarray(expected)
    if found.dtype.kind not in "fiub":
        return found.shape == expected.shape and bool((found == expected).all())
    return found.shape == expected.shape and np.allclose(found, expected, within, within)


@cache
def series(read: Reading) -> Reading:
    """Return a reading after the reset and after each step of a robot that moves its legs."""

    def step(robot: Robot, action: np.ndarray) -> Any:
        robot.step(action)
        return read(robot)

    return lambda robot: np.array([read(robot), *(step(robot, action) for action in WAVES)])


@cache
def after(read: Reading, action: tuple[float, ...] = tuple(HOME), steps: int = 1) -> Reading:
    """Return a reading after `steps` steps with an action."""
    return lambda robot: [*(robot.step(np.array(action)) for _ in range(steps)), read(robot)][-1]


def scene(**parts: Any) -> dict[str, Any]:
    return {"scenario": quad_env.Scenario("made", **{"start": CALM} | parts)}


def part(name: str) -> Callable[[Any], dict[str, Any]]:
    """Return a function from settings to the arguments that pass them as a part of a scenario."""
    return lambda settings: scene(**{name: settings})


def suite(name: str) -> Callable[[Any], dict[str, Any]]:
    return lambda settings: scene() | {"sensors": replace(IDEAL, **{name: settings})}


def streams() -> EpisodeStreams:
    return EpisodeStreams(SEED, 0)
