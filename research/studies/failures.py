"""Episodes that are made to fail for a known cause, to test the rules that find causes of failure.

A case has a policy, a scenario, and the seeds of six episodes. There are two cases for each cause.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.causes import rules
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from policies.base import Actions, Policy, within_limits
from policies.trot.open_loop import Trot, searched_parameters
from quad_env import AnyPose, CommandRanges, Imu, Scenario, SensorSuite, StartNoise
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.terrain import Stairs
from quad_env.seeding import episode_seeds

Rows = NDArray[np.float32]
"""Type of the observations of n robots, (n, k): one row of k numbers for each robot."""


class PerturbedPolicy(Policy):
    """Wrapper of a policy that perturbs its observation or its action, or marks it as failed.

    Args:
        policy: Policy that is perturbed.
        observation_transform: Function that takes the true observations of n robots, (n, k) with k numbers for each
            robot, and returns the observations that the policy receives, (n, k).
        action_transform: Function that takes the policy's joint targets, (n, 12), rad, and the true observations,
            (n, k), and returns the executed joint targets, (n, 12), rad.
        failing: Number of control steps after which the policy is marked as failed; infinite if it never fails.
    """

    name = "altered"

    def __init__(
        self,
        policy: Policy,
        observation_transform: Callable[[Rows], Rows] = lambda rows: rows,
        action_transform: Callable[[Actions, Rows], Actions] = lambda actions, _: actions,
        failing: float = np.inf,
    ) -> None:
        super().__init__(robot=policy.robot, control_period=policy.control_period)
        self._policy = policy
        self._observation_transform = observation_transform
        self._action_transform = action_transform
        self._first_failing_step = failing

    def _allocate(self, num_envs: int) -> None:
        self._policy.reset(num_envs)
        self._step = 0
        self.failure = np.full(num_envs, None, dtype=object)

    def _act(self, observation: Rows) -> Actions:
        self._step += 1
        if self._step > self._first_failing_step:
            self.failure[:] = "gave targets that are not finite"
        actions = self._policy.act(self._observation_transform(observation.copy()))
        actions = self._action_transform(actions, observation)
        return within_limits(self.robot, actions.astype(np.float32))


@dataclass(frozen=True)
class FailureCase:
    """Definition of six episodes that are made to fail for a known cause."""

    cause: str
    """Name of the true cause of the failures, for example `slip`, as in `evaluate.causes.rules.CAUSES`."""
    policy: Callable[[], Policy]
    """Function without arguments that creates the policy."""
    scenario: Scenario
    """Scenario of the six episodes: terrain, disturbances and commands."""
    steps: int = 150
    """Duration of an episode, control steps of 10 ms."""
    hardware: HardwareConfig = IDEAL
    """Models of motors, sensors and estimator; by default ideal motors and sensors."""
    chosen: tuple[int, ...] = tuple(range(6))
    """Indices of the six episode seeds among the first 96 validation seeds, 0 … 95.

    The episodes with these seeds fail for the cause."""

    def run(self, after_falls: bool = False) -> Episodes:
        """Simulate and record the six episodes; if `after_falls` is True, an episode continues after a fall."""
        seeds = episode_seeds("validation", 0, 96)[list(self.chosen)]
        policy = self.policy()
        recorder = rollout.EpisodeRecorder(policy, seeds, self.steps)
        rollout.roll_out(
            policy,
            self.scenario,
            seeds,
            recorder,
            steps=self.steps,
            hardware=self.hardware,
            terminate_on_fall=not after_falls,
        )
        return recorder.episodes()


def _make_policy(name: str, **altered: Any) -> Callable[[], Policy]:
    """Return a function that makes the policy `name`, in a PerturbedPolicy if there are arguments for it.

    `altered` are the arguments of PerturbedPolicy except the policy: name -> value.
    """
    make = partial(policies.make, name, servo="own")
    return lambda: PerturbedPolicy(make(), **altered) if altered else make()


def _make_trot(**parameters: float) -> Callable[[], Policy]:
    """Return a function that makes an open-loop trot with changed gait parameters.

    `parameters` are the changed gait parameters: name -> value.
    """
    return lambda: Trot(replace(searched_parameters(), **parameters))


def _slower(rows: Rows) -> Rows:
    """Halve the commanded velocity in observations in place, so that the robot walks too slowly.

    `rows` are the observations, (n, k); the last three numbers of a row are the commanded velocity.
    """
    rows[:, -3:] *= 0.5
    return rows


def _toppling(actions: Actions, observation: Rows) -> Actions:
    """Change joint targets so that the legs push a leaning trunk further over, until it falls.

    Args:
        actions: Joint targets of the policy, (n, 12), rad.
        observation: True observations of n robots, (n, k); the first three numbers of a row are the direction of
            gravity, base frame.

    Returns:
        Changed joint targets, (n, 12), rad. The abduction targets change by -6 rad times the y component of gravity,
        and the hip targets by -6 rad times the x component. These changes increase the lean of the trunk.
    """
    lean = -6.0 * observation[:, [1, 0, 0]] * (1.0, 1.0, 0.0)
    return actions + np.tile(lean, 4).astype(np.float32)


def _make_scenario(speed: float | tuple[float, float] = 0.5, **settings: Any) -> Scenario:
    """Create a scenario in which a robot walks straight ahead, with disturbances by `settings`.

    `speed` is the commanded forward velocity or its range, m/s. `settings` are fields of the scenario, for example its
    terrain; the field `commands` replaces the commands of `speed`.
    """
    low, high = (speed, speed) if isinstance(speed, float) else speed
    commands = CommandRanges((low, high), (0.0, 0.0), (0.0, 0.0), zero_fraction=0.0)
    return Scenario("made", **{"commands": commands} | settings)


ALONG = StartNoise(yaw=0.0)
"""Random initial state, in which only the heading is fixed at 0, so that the robot faces the stairs."""
CURVES = CommandRanges((1.2, 1.5), (-0.3, 0.3), (-1.2, 1.2), 0.0, 2.0)
"""Ranges of velocity commands for fast walks with turns; a new command is drawn every 2 s."""
TILTED_IMU: Any = SensorSuite(imu=Imu(rotation=(0.0, 0.7, 0.0)))
"""Sensors with a wrongly mounted IMU: it is rotated by 0.7 rad about the y axis of the trunk.

The estimator assumes an IMU that is not rotated.
"""
STAIRS_15_CM = Stairs(0.15)
"""Terrain of stairs with a step height of 0.15 m."""
ICE = Ground(0.05)
"""Ground with a friction coefficient of 0.05, on which feet slip."""
WEAK_MOTORS = Motors(10.0)
"""Weak motors with a torque limit of 10 N·m, a tenth of the rated torque of SimpleQuad."""
LONG_LATENCY = Latency(0.08, 0.08)
"""Delays of 0.08 s for the actions and 0.08 s for the observations."""
LONG_DROPOUTS = Dropouts(4, 0.95, (0.1, 4.0))
"""Four dropouts of 0.95 s each, in the time from 0.1 to 4 s.

In a dropout, one joint servo receives no new targets, and holds its last target.
"""
STAIRS_UP = _make_scenario(0.8, terrain=STAIRS_15_CM, start=ALONG)
"""Scenario in which the robot walks at 0.8 m/s towards stairs with a step height of 0.15 m."""
LYING = _make_scenario(start=AnyPose())
"""Scenario in which the robots start lying in a random pose, some of them upside down."""
CASES = (
    FailureCase(rules.TRIP, _make_policy("robust"), _make_scenario(0.8, terrain=Stairs(0.2), start=ALONG), 120),
    FailureCase(rules.TRIP, _make_policy("end_to_end"), STAIRS_UP, 160, chosen=(3, 4, 5, 10, 11, 12)),
    FailureCase(rules.SLIP, _make_policy("end_to_end"), _make_scenario(ground=ICE, commands=CURVES)),
    FailureCase(rules.SLIP, _make_policy("trot"), _make_scenario(ground=ICE, commands=CURVES)),
    FailureCase(
        rules.PUSH, _make_policy("trot_feedback"), _make_scenario(pushes=Pushes(1, 150.0, window=(0.8, 1.2))), 220
    ),
    FailureCase(rules.PUSH, _make_policy("residual"), _make_scenario(force=SteadyForce(140.0))),
    FailureCase(rules.MOTOR, _make_policy("residual"), _make_scenario(0.8, motors=WEAK_MOTORS)),
    FailureCase(rules.MOTOR, _make_policy("end_to_end"), _make_scenario(motors=WEAK_MOTORS, commands=CURVES)),
    FailureCase(rules.REACH, _make_trot(body_height=0.62), _make_scenario(0.8)),
    FailureCase(rules.REACH, _make_trot(stance_width=0.2, frequency=1.5), _make_scenario(0.8)),
    FailureCase(
        rules.ESTIMATE,
        _make_policy("trot_feedback"),
        _make_scenario(noise=SensorNoise(2.4)),
        180,
        chosen=(4, 6, 12, 15, 21, 28),
    ),
    FailureCase(
        rules.ESTIMATE, _make_policy("end_to_end"), _make_scenario(), hardware=HardwareConfig(sensors=TILTED_IMU)
    ),
    FailureCase(
        rules.SIGNAL,
        _make_policy("end_to_end"),
        _make_scenario(0.8, latency=LONG_LATENCY),
        200,
        chosen=(4, 7, 9, 12, 19, 28),
    ),
    FailureCase(
        rules.SIGNAL,
        _make_policy("end_to_end"),
        _make_scenario((1.8, 2.3), dropouts=LONG_DROPOUTS),
        230,
        chosen=(2, 12, 31, 53, 92, 93),
    ),
    FailureCase(rules.GAIT, _make_policy("document"), _make_scenario()),
    FailureCase(rules.GAIT, _make_policy("stand", action_transform=_toppling), _make_scenario()),
    FailureCase(rules.SLOW, _make_policy("trot", observation_transform=_slower), _make_scenario(1.2)),
    FailureCase(rules.SLOW, _make_policy("residual", observation_transform=_slower), _make_scenario(1.5)),
    FailureCase(rules.STALLED, _make_policy("stand"), _make_scenario()),
    FailureCase(rules.STALLED, _make_policy("trot"), STAIRS_UP),
    FailureCase(rules.POLICY, _make_policy("trot", failing=80), _make_scenario()),
    FailureCase(rules.POLICY, _make_policy("stand", failing=1), _make_scenario()),
    FailureCase(rules.UNCLEAR, _make_policy("trot"), LYING, chosen=(0, 1, 2, 5, 6, 8)),
    FailureCase(rules.UNCLEAR, _make_policy("residual"), LYING, chosen=(0, 1, 2, 5, 6, 8)),
)
"""Cases for all causes of failure: two cases, with six episodes each, for every cause."""
