"""What the single environment and the batch have in common: their parts, how these start, and copies."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import partial
from typing import Any, ClassVar, Self, TypedDict

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from quad_env.actuation.hardware import hardware_profile
from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.actuation.models import actuator as find_actuator
from quad_env.actuation.runtime import action_delay_of
from quad_env.columns import BoolOrMask, Components, EnvIndices, ScalarOrBatch, fraction_above
from quad_env.config import TaskConfig
from quad_env.envs.attributes import check_settable
from quad_env.physics.batch import MUJOCO
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot, parse_servo_gains
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.episode import EpisodeSample, stack_initial_conditions
from quad_env.scenarios.named import scenario as find_scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.schedule import EpisodeSchedule
from quad_env.sensing.estimators import COMPLEMENTARY, Estimator, check_estimator
from quad_env.sensing.height_scan import HeightScan, make_scanner, table_with
from quad_env.sensing.observation import SensorObservation, make_observation_model
from quad_env.sensing.suite import SensorSuite, sensor_suite
from quad_env.serialisation import from_plain
from quad_env.task.observations import ObservationTerm, user_terms
from quad_env.task.rewards import reward_terms, step_weights, user_rewards


class EnvKwargs(TypedDict, total=False):
    """Arguments that the single environment and the batch share; `SimpleQuadEnv` says what they are."""

    config: TaskConfig | None
    actuator: str | Actuator
    sensors: str | SensorSuite | None
    robot: str | Robot
    estimator: str
    height_scan: HeightScan | None
    rewards: Mapping[str, Any] | None
    observations: Sequence[str | ObservationTerm]
    servo: Any
    simulator: str


class QuadEnvBase:
    """Environment base class: a copy or an unpickled one is a new environment with the same arguments, not yet reset.

    A `reset` without a seed gives a copy the next episode of the original. The state of MuJoCo's simulation can be
    neither copied nor pickled.

    Setting a public attribute outside of `SETTABLE` after construction raises AttributeError. A subclass may set
    attributes of its own, and spaces.
    """

    SETTABLE: ClassVar[frozenset[str]] = frozenset()
    """Attributes that take effect when they are set."""
    _view: Any = None  # so that what was made in part can be closed
    _made = False
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute. Raises AttributeError where that would change nothing."""
        if name[0] != "_" and self._made:
            check_settable(self, name, value, EnvKwargs.__annotations__)
        object.__setattr__(self, name, value)

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """An environment that remembers what it was made with."""
        env = super().__new__(cls)
        env._arguments = args, kwargs
        return env

    def __reduce__(self) -> tuple[Any, ...]:
        (args, kwargs), kept = self._arguments, ("spec", "_schedule")
        return partial(type(self), *args, **kwargs), (), {name: deepcopy(getattr(self, name)) for name in kept}

    def _build(
        self,
        num_envs: int,
        nthread: int,
        scenario: str | Scenario,
        readings: bool = False,
        *,
        config: TaskConfig | None = None,
        actuator: str | Actuator = "ideal",
        sensors: str | SensorSuite | None = None,
        robot: str | Robot = SIMPLE_QUAD,
        estimator: str = COMPLEMENTARY,
        height_scan: HeightScan | None = None,
        rewards: Mapping[str, Any] | None = None,
        observations: Sequence[str | ObservationTerm] = (),
        servo: Any = None,
        simulator: str = MUJOCO,
    ) -> tuple["Box[np.float32]", "Box[np.float32]"]:
        """Make the parts of n robots; the spaces of observations and of actions of one.

        Mappings stand for settings, as in an `EnvSpec` that went through JSON.
        """
        config = _setting(config)
        if config is not None and not isinstance(config, TaskConfig):
            raise ValueError(f"config is a quad_env.TaskConfig or None, got {config!r}")
        self.config = config or TaskConfig()
        robot = get_robot(robot)
        own = robot.servo_stiffness, robot.servo_damping
        gains = parse_servo_gains(own if servo is None else servo, num_envs)
        differ = bool(np.ptp(gains, axis=1).any())
        self.robot = robot = robot.with_servo(*(gains.mean(axis=1) if differ else gains[:, 0]))
        """All that the environment knows of the robot; the mean of the servo gains where robots differ."""
        self.scenario = find_scenario(_setting(scenario), robot)
        """What the robot has to cope with."""
        rate = self.config.control_rate
        self.dt = 1 / rate
        """Control period, s."""
        self._min_trunk_height = self.config.fall_rule.lowest(robot.leg_length)
        motors, suite = find_actuator(_setting(actuator)), sensor_suite(_setting(sensors))
        if self.scenario.hardware:
            if (motors, suite, estimator) != (ACTUATORS["ideal"], None, COMPLEMENTARY):
                has = f"{self.scenario.name} has the robot's hardware profile"
                raise ValueError(f"{has}: leave out actuator, sensors and estimator, or take the scenario without it")
            motors, named, estimator = hardware_profile(robot)
            suite = sensor_suite(named)
        check_estimator(estimator, suite)
        imu = None if suite is None else (suite.imu.position, suite.imu.rotation)
        self._user_rewards = user_rewards(rewards)
        self._user_terms = user_terms(observations)
        self._weights = step_weights(self.config.reward_weights, self.dt)
        self._reward_keys = (*self._weights, *self._user_rewards)
        weights = self.config.reward_weights
        weighted_feet = weights.foot_air_time != 0.0 or weights.touchdown_speed != 0.0
        feet = weighted_feet or bool(self._user_rewards or self._user_terms)
        self.simulation = Simulation(
            *(robot, self.scenario, num_envs, nthread, rate, readings, motors, imu, feet),
            timestep=self.config.timestep,
            solver_iterations=self.config.solver_iterations,
            servo=gains if differ else None,
            simulator=simulator,
        )
        self._schedule = EpisodeSchedule(robot, self.scenario, num_envs, self.dt)
        self._action_delay = action_delay_of(robot, self.scenario, num_envs, self.dt)
        self._sensors = make_observation_model(suite, estimator, self.simulation, self.scenario, num_envs, rate)
        scan = _setting(height_scan)
        self._scanner = make_scanner(scan, self.scenario, num_envs, rate)
        self.observation_table = table = table_with(robot, scan, self._user_terms)
        """Terms and slices of the observation."""
        self._lower, self._upper = robot.joint_lower, robot.joint_upper
        actions = Box(self._lower.astype(np.float32), self._upper.astype(np.float32))
        return Box(-table.bound, table.bound), actions

    @property
    def estimator(self) -> Estimator | None:
        """What gravity and velocity of the observation are estimated by; None where they are the truth."""
        return self._sensors.estimator if isinstance(self._sensors, SensorObservation) else None

    @property
    def observes_true_state(self) -> bool:
        """Whether the observation shows every reading as it is, at once."""
        return self._sensors is None

    def _reset_episodes(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots."""
        self.simulation.reset(env_ids, *stack_initial_conditions(episodes))
        for part in (self._action_delay, self._sensors, self._scanner):
            if part is not None:
                part.reset(env_ids, episodes)

    def _observation_of(
        self,
        state: QuadState[ScalarOrBatch],
        command: Components[ScalarOrBatch],
        clock: NDArray[np.int64],
        env_ids: EnvIndices,
    ) -> NDArray[np.float32]:
        """What those robots, (k,), observe, whose `state` it is: (size,), or (k, size) of a batch."""
        observation: NDArray[np.float32] = self.observation_table.observe(state, command)
        if self._sensors is not None:
            self._sensors.sense(np.atleast_2d(observation), clock, env_ids)
        further: list[NDArray[np.float32]] = [term.evaluate(state) for term in self._user_terms]
        if self._scanner is not None:
            further.insert(0, self._scanner.scan(state, clock, env_ids))
        if not further:
            return observation
        return np.concatenate((observation, *(part if observation.ndim == 2 else part[0] for part in further)), axis=-1)

    def _step_terms(
        self, state: QuadState[ScalarOrBatch], ended: BoolOrMask, diverged: BoolOrMask
    ) -> dict[str, ScalarOrBatch]:
        """What a step earned and cost: mechanical power, W, the share of joints above their rated speed, rewards."""
        return {
            "mechanical_power": state.mechanical_power,
            "overspeed": fraction_above(state.joint_velocity, self.robot.rated_speed),
            **reward_terms(state, ended, diverged, self._weights),
            **{key: term.weighted(state, diverged, self.dt) for key, term in self._user_rewards.items()},
        }

    def close_extras(self, **_: Any) -> None:
        """Close the window or the renderer; the simulation itself needs no closing."""
        if self._view is not None:
            self._view.close()
            self._view = None


def _setting(value: Any) -> Any:
    return from_plain(value) if isinstance(value, Mapping) else value
