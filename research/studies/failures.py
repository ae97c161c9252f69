"""Episodes that were made to fail for a known cause: twelve of each, in two batches of six."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.causes import rules
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from evaluate.rollouts.hardware import IDEAL, Hardware
from policies.base import Actions, Policy, within_limits
from policies.trot.open_loop import Trot, searched_parameters
from quad_env import AnyPose, CommandRanges, Imu, Scenario, SensorSuite, StartNoise
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import (
    Dropouts,
    Ground,
    Latency,
    Motors,
    Pushes,
    SensorNoise,
    SteadyForce,
)
from quad_env.scenarios.terrain import Stairs
from quad_env.seeding import episode_seeds

Rows = NDArray[np.float32]


class Altered(Policy):
    """A policy that is shown, and asks for, something else than the one within it; `failing` from a step on."""

    name = "altered"

    def __init__(
        self,
        policy: Policy,
        shown: Callable[[Rows], Rows] = lambda rows: rows,
        asked: Callable[[Actions, Rows], Actions] = lambda actions, _: actions,
        failing: int | None = None,
    ) -> None:
        super().__init__(robot=policy.robot, control_period=policy.control_period)
        self._policy, self._shown, self._asked, self._failing, self._step = policy, shown, asked, failing, 0
        if failing is not None:
            self.failure = np.full(1, None, dtype=object)

    def _allocate(self, num_envs: int) -> None:
        self._policy.reset(num_envs)
        self._step = 0
        if self._failing is not None:
            self.failure = np.full(num_envs, None, dtype=object)

    def _act(self, observation: Rows) -> Actions:
        self._step += 1
        actions = self._asked(self._policy.act(self._shown(observation.copy())), observation)
        if self._failing is not None and self._step > self._failing:
            self.failure[:] = "gave targets that are not finite"
            actions = np.tile(self.robot.home_pose, (len(actions), 1)).astype(np.float32)
        return within_limits(self.robot, actions.astype(np.float32))


@dataclass(frozen=True)
class Sensing(Hardware):
    """Hardware with sensors of one's own."""

    suite: SensorSuite | None = None

    def environment(self, robot: Robot) -> dict[str, Any]:
        """See `Hardware`."""
        return super().environment(robot) | {"sensors": self.suite}


@dataclass(frozen=True)
class Case:
    """Six episodes that fail for a cause."""

    cause: str
    policy: Callable[[], Policy]
    scenario: Scenario
    steps: int = 150
    hardware: Hardware = IDEAL
    chosen: tuple[int, ...] = tuple(range(6))
    """Numbers of the validation seeds, on which it does fail."""

    def run(self, after_falls: bool = False) -> Episodes:
        """Their record."""
        seeds = episode_seeds("validation", 0, 96)[list(self.chosen)]
        policy, how = self.policy(), dict[str, Any](steps=self.steps, hardware=self.hardware)
        recorder = rollout.Recorder(policy, seeds, self.steps)
        rollout.roll_out(policy, self.scenario, seeds, recorder, terminate_on_fall=not after_falls, **how)
        return recorder.episodes()


def _named(name: str) -> Callable[[], Policy]:
    return lambda: policies.make(name)


def _trot(**parameters: float) -> Callable[[], Policy]:
    return lambda: Trot(replace(searched_parameters(), **parameters))


def _slower(rows: Rows) -> Rows:
    rows[:, -3:] *= 0.5
    return rows


def _toppling(actions: Actions, observation: Rows) -> Actions:
    """Hips and thighs that push the way the trunk leans."""
    lean = -6.0 * observation[:, [1, 0, 0]] * (1.0, 1.0, 0.0)
    return actions + np.tile(lean, 4).astype(np.float32)


def _made(name: str = "made", speed: float | tuple[float, float] = 0.5, **settings: Any) -> Scenario:
    low, high = (speed, speed) if isinstance(speed, float) else speed
    return Scenario(name, commands=CommandRanges((low, high), (0.0, 0.0), (0.0, 0.0), zero_fraction=0.0), **settings)


ALONG = StartNoise(yaw=0.0)
"""Starts that face the stairs."""
CURVES = CommandRanges((1.2, 1.5), (-0.3, 0.3), (-1.2, 1.2), 0.0, 2.0)
RISERS, ICE, TURNED = Stairs(0.15), Ground(0.05), SensorSuite(imu=Imu(rotation=(0.0, 0.7, 0.0)))
"""0.15 m a step; friction; an IMU that is mounted 0.7 rad off about the trunk's y axis, unknown to the estimator."""
FAST, LYING = (1.8, 2.3), (0, 1, 2, 5, 6, 8)
LATE, LOST = Latency(0.08, 0.08), Dropouts(4, 0.95, (0.1, 4.0))
CASES = (
    Case(rules.TRIP, _named("robust"), _made(speed=0.8, terrain=Stairs(0.2), start=ALONG), 120),
    Case(
        rules.TRIP,
        _named("end_to_end"),
        _made(speed=0.8, terrain=RISERS, start=ALONG),
        160,
        chosen=(3, 4, 5, 10, 11, 12),
    ),
    Case(rules.SLIP, _named("end_to_end"), replace(_made(ground=ICE), commands=CURVES)),
    Case(rules.SLIP, _named("trot"), replace(_made(ground=ICE), commands=CURVES)),
    Case(rules.PUSH, _named("trot_feedback"), _made(pushes=Pushes(1, 150.0, window=(0.8, 1.2))), 220),
    Case(rules.PUSH, _named("residual"), _made(force=SteadyForce(140.0))),
    Case(rules.MOTOR, _named("residual"), _made(speed=0.8, motors=Motors(10.0))),
    Case(rules.MOTOR, _named("end_to_end"), replace(_made(motors=Motors(10.0)), commands=CURVES)),
    Case(rules.REACH, _trot(body_height=0.62), _made(speed=0.8)),
    Case(rules.REACH, _trot(stance_width=0.2, frequency=1.5), _made(speed=0.8)),
    Case(rules.ESTIMATE, _named("trot_feedback"), _made(noise=SensorNoise(2.4)), 180, chosen=(4, 6, 12, 15, 21, 28)),
    Case(rules.ESTIMATE, _named("end_to_end"), _made(), hardware=Sensing(suite=TURNED)),
    Case(rules.SIGNAL, _named("end_to_end"), _made(speed=0.8, latency=LATE), 200, chosen=(4, 7, 9, 12, 19, 28)),
    Case(rules.SIGNAL, _named("end_to_end"), _made(speed=FAST, dropouts=LOST), 230, chosen=(2, 12, 31, 53, 92, 93)),
    Case(rules.GAIT, _named("document"), _made()),
    Case(rules.GAIT, lambda: Altered(policies.make("stand"), asked=_toppling), _made()),
    Case(rules.SLOW, lambda: Altered(policies.make("trot"), shown=_slower), _made(speed=1.2)),
    Case(rules.SLOW, lambda: Altered(policies.make("residual"), shown=_slower), _made(speed=1.5)),
    Case(rules.STALLED, _named("stand"), _made()),
    Case(rules.STALLED, _named("trot"), _made(speed=0.8, terrain=RISERS, start=ALONG)),
    Case(rules.POLICY, lambda: Altered(policies.make("trot"), failing=80), _made()),
    Case(rules.POLICY, lambda: Altered(policies.make("stand"), failing=1), _made()),
    Case(rules.UNCLEAR, _named("trot"), replace(_made(), start=AnyPose()), chosen=LYING),
    Case(rules.UNCLEAR, _named("residual"), replace(_made(), start=AnyPose()), chosen=LYING),
)
"""Twelve episodes of each cause."""
