"""A robot alone or of a batch, and the effect of a value on a reading of it."""

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
"""Of the robot that is looked at. Control steps of a series. Period, s."""
HOME, FAR = SIMPLE_QUAD.home_pose, tuple(SIMPLE_QUAD.joint_upper)
"""FAR is out of reach of every servo for some steps."""
WAVES = HOME + np.random.default_rng(0).uniform(-0.15, 0.15, (STEPS, 12))
CALM = quad_env.StartNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IDEAL = quad_env.SENSORS["ideal"]
STRAIGHT = quad_env.CommandRanges(zero_fraction=0.0, interval=0.02)
SCAN = quad_env.HeightScan(ahead=1, behind=0, aside=1)


class Robot:
    """A robot alone, or the second of a batch, whose others are asked for something else and are steps ahead of it.

    It has moved in an episode before, of which nothing is to be left.
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
        """Of something that a batch has for each robot."""
        return value if self.alone else value[self.row]

    @property
    def now(self) -> Any:
        """Its simulation; the model, too, is its own from here on."""
        return self.base.simulation.snapshot(self.row)

    @property
    def model(self) -> Any:
        return self.base.simulation.model


Reading = Callable[[Robot], Any]


@dataclass(frozen=True)
class Effect:
    """What a value is for: with it the reading, which was another, is what is expected, `within` so much of it."""

    value: Any
    reading: Reading
    expected: Any
    """Or a function from what the reading is at the usual value."""
    given: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Arguments without which the value means nothing."""
    within: float = 1e-5

    def of(self, alone: bool, options: dict[str, Any]) -> Any:
        """The reading of a robot that is made with these arguments."""
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
    """A reading after the reset and after each step of a robot that waves its legs."""

    def step(robot: Robot, action: np.ndarray) -> Any:
        robot.step(action)
        return read(robot)

    return lambda robot: np.array([read(robot), *(step(robot, action) for action in WAVES)])


@cache
def after(read: Reading, action: tuple[float, ...] = tuple(HOME), steps: int = 1) -> Reading:
    """A reading after so many steps towards that."""
    return lambda robot: [*(robot.step(np.array(action)) for _ in range(steps)), read(robot)][-1]


def scene(**parts: Any) -> dict[str, Any]:
    return {"scenario": quad_env.Scenario("made", **{"start": CALM} | parts)}


def part(name: str) -> Callable[[Any], dict[str, Any]]:
    """The arguments that hand over this part of a scenario."""
    return lambda settings: scene(**{name: settings})


def suite(name: str) -> Callable[[Any], dict[str, Any]]:
    return lambda settings: scene() | {"sensors": replace(IDEAL, **{name: settings})}


def streams() -> EpisodeStreams:
    return EpisodeStreams(SEED, 0)
