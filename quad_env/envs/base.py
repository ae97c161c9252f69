"""Base class of the single and the vector environment: construction, episode start, step, copying."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypedDict, Unpack

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from quad_env.actuation.hardware import hardware_profile
from quad_env.actuation.models import ACTUATORS, Actuator, find_actuator
from quad_env.actuation.runtime import make_action_delay
from quad_env.columns import (
    Array,
    BoolOrMask,
    EnvIndices,
    EnvSelection,
    Mask,
    ScalarOrBatch,
    any_true,
    component_reader,
    fraction_above,
    where,
)
from quad_env.config import TaskConfig
from quad_env.envs.attributes import check_settable
from quad_env.physics.model import Mounting
from quad_env.physics.simulation import ALL, Coordinates, Simulation, SimulationConfig
from quad_env.physics.simulators import MUJOCO
from quad_env.physics.state import QuadState
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.episode import EpisodeSample, moved_properties, stack_initial_conditions
from quad_env.scenarios.registry import scenario as find_scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.schedule import EpisodeSchedule
from quad_env.scenarios.severity import at_severity
from quad_env.sensing.estimators import COMPLEMENTARY, Estimator, check_estimator
from quad_env.sensing.height_scan import HeightScan, make_scanner, table_with
from quad_env.sensing.observation import make_observation_model
from quad_env.sensing.suite import SensorSuite, sensor_suite
from quad_env.serialisation import from_json_values
from quad_env.task.observations import ObservationTerm, user_terms
from quad_env.task.rewards import FOOT_TERMS, reward_terms, step_weights, user_rewards
from quad_env.task.terminations import fall_reason_code

STATE_KEYS = ("mechanical_power", "overspeed")
"""Keys in the infos of the terms of a step that are no reward terms."""


class EnvKwargs(TypedDict, total=False):
    """Types of the keyword arguments that the single and the vector environment share; see `SimpleQuadEnv`."""

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


@dataclass(frozen=True, eq=False)
class EnvOptions:
    """Values and defaults of the keyword arguments of an environment, which `SimpleQuadEnv` describes."""

    config: TaskConfig | None = None
    actuator: str | Actuator = "ideal"
    sensors: str | SensorSuite | None = None
    robot: str | Robot = SIMPLE_QUAD
    estimator: str = COMPLEMENTARY
    height_scan: HeightScan | None = None
    rewards: Mapping[str, Any] | None = None
    observations: Sequence[str | ObservationTerm] = ()
    servo: Any = None
    simulator: str = MUJOCO


class Equipment(NamedTuple):
    """Hardware and software of the robot: model of the joint servos, sensors, and name of the state estimator."""

    actuator: Actuator
    sensors: SensorSuite | None
    estimator: str

    @property
    def imu(self) -> Mounting | None:
        """Position, base frame, m, and roll, pitch, yaw, rad, of the IMU; None if the robot has no sensors."""
        return None if self.sensors is None else (self.sensors.imu.position, self.sensors.imu.rotation)


class StepOutcome(NamedTuple, Generic[ScalarOrBatch]):
    """Results of a control step: floats for one robot, or arrays, (k,), for k robots."""

    state: QuadState[ScalarOrBatch]
    """State after the step; `state.command` is the velocity command that the robot tracked in the step."""
    observation: NDArray[np.float32]
    """Observation after the step, (size,) or (k, size)."""
    terms: dict[str, ScalarOrBatch]
    """Key in the infos -> value.

    The values are the mechanical power, W, the fraction of joints above their rated speed, and all reward terms.
    """
    fall: Any
    """Index of the reason of the fall in `config.FALL_REASONS`, an int or (k,); 0 for no fall."""
    diverged: BoolOrMask
    """True for robots with a diverged simulation: MuJoCo warned, or the state is not finite."""
    terminated: BoolOrMask
    """True for robots with an episode that ends by a fall or by a diverged simulation."""


class QuadEnvBase:
    """Base class of `SimpleQuadEnv` and `SimpleQuadVectorEnv`: simulation, episodes, sensors and task.

    Copying or unpickling makes a new environment with the same arguments, because the state of MuJoCo's simulation
    cannot be copied or pickled. Reset the copy before its first step. The first episode of the copy, after a `reset`
    without a seed, is the next episode of the original.

    After construction, an assignment to a public attribute that is not in `SETTABLE` raises AttributeError. A subclass
    may set new attributes, and replace the observation and action spaces.
    """

    SETTABLE: ClassVar[frozenset[str]] = frozenset()
    """Names of the public attributes that may be set after construction."""
    terminate_on_fall: bool
    """True if a fall ends the episode."""
    _view: Any = None
    """Window or offscreen renderer of the environment; None before the first frame.

    This is a class attribute, because `close_extras` reads it even if the constructor failed.
    """
    _has_moved = False
    """True after a reset with severities; only then, `reset` writes friction and payload into the models."""
    _made = False
    """True after the constructor has finished; only then, `__setattr__` checks assignments."""
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __setattr__(self, name: str, value: Any) -> None:
        """Set the attribute `name` to `value`; raise AttributeError if the assignment would have no effect."""
        if name[0] != "_" and self._made:
            check_settable(self, name, value, EnvKwargs.__annotations__)
        object.__setattr__(self, name, value)

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Create an environment and store the constructor arguments, which copies and pickles need."""
        env = super().__new__(cls)
        env._arguments = args, kwargs
        return env

    def __reduce__(self) -> tuple[Any, ...]:
        args, kwargs = self._arguments
        state = {name: deepcopy(getattr(self, name)) for name in ("spec", "_schedule", "_has_moved")}
        return partial(type(self), *args, **kwargs), (), state

    def _build(
        self,
        num_envs: int,
        nthread: int,
        scenario: str | Scenario,
        *,
        readings: bool,
        visuals: bool,
        **kwargs: Unpack[EnvKwargs],
    ) -> tuple["Box[np.float32]", "Box[np.float32]"]:
        """Create the simulation, the task and the episode schedule of n robots.

        An argument may be a mapping in place of a settings dataclass, because a Gymnasium `EnvSpec` that was stored as
        JSON contains mappings.

        Args:
            num_envs: Number of robots.
            nthread: Number of simulation threads.
            scenario: Scenario or its name.
            readings: True to measure motors, foot forces, and ground contacts of feet and legs in every step.
            visuals: False to simulate a model without the geoms that do not collide.
            **kwargs: Keyword arguments `EnvKwargs`; `SimpleQuadEnv` describes them.

        Returns:
            observation_space: Observation space of one robot.
            action_space: Action space of one robot.
        """
        options = EnvOptions(**kwargs)
        self.config = _check_task_config(_to_setting(options.config))
        self.dt = 1 / self.config.control_rate
        """Control period, s."""
        self.robot, servo_gains = make_robot(options.robot, options.servo, num_envs)
        """Model of the simulated robot; if the servo gains differ between the n robots, the model has their mean."""
        self.scenario = find_scenario(_to_setting(scenario), self.robot)
        """Scenario of all episodes: terrain, commands, disturbances and initial state."""
        equipment = self._select_equipment(options)
        self._build_task(options)
        simulation_config = replace(
            self._make_simulation_config(options, equipment, servo_gains),
            num_envs=num_envs,
            nthread=nthread,
            has_meter=readings,
            visuals=visuals,
        )
        self.simulation = Simulation(self.robot, self.scenario, simulation_config)
        """Simulation of the n robots."""
        self._build_episodes(options, equipment, num_envs)
        self._lower = self.robot.joint_lower
        self._upper = self.robot.joint_upper
        bound = self.observation_table.bound
        return Box(-bound, bound), Box(self._lower.astype(np.float32), self._upper.astype(np.float32))

    def _make_simulation_config(
        self, options: EnvOptions, equipment: Equipment, servo_gains: NDArray[np.float64] | None
    ) -> SimulationConfig:
        """Return the options of the simulation that follow from the task, the sensors and the servos."""
        return SimulationConfig(
            control_rate=self.config.control_rate,
            timestep=self.config.timestep,
            solver_iterations=self.config.solver_iterations,
            physics=self.config.physics,
            simulator=options.simulator,
            actuator=equipment.actuator,
            servo_gains=servo_gains,
            imu=equipment.imu,
            tracks_footsteps=self._tracks_footsteps,
        )

    def _build_task(self, options: EnvOptions) -> None:
        """Prepare fall detection, reward weights, and the reward and observation terms of the user."""
        weights = self.config.reward_weights
        self._min_trunk_height = self.config.fall_rule.min_trunk_height(self.robot.leg_length)
        self._reward_weights = step_weights(weights, self.dt)
        self._user_rewards = user_rewards(options.rewards)
        self._reward_keys = (*self._reward_weights.keys, *self._user_rewards)
        """Keys of all reward terms in the infos, `reward_<name>`; the reward is the sum of these terms."""
        weighted_keys = (*self._reward_weights.weighted_keys, *self._user_rewards)
        self._weighted_keys = weighted_keys or self._reward_keys
        """Keys of the reward terms that are not always 0, or all keys if all terms are always 0.

        A built-in term with the weight 0 is always 0.
        """
        self._user_terms = user_terms(options.observations)
        has_weighted_feet = any(getattr(weights, name) != 0.0 for name in FOOT_TERMS)
        self._tracks_footsteps = has_weighted_feet or bool(self._user_rewards or self._user_terms)

    def _build_episodes(self, options: EnvOptions, equipment: Equipment, num_envs: int) -> None:
        """Create the objects that every episode resets.

        These objects are the episode schedule, action delay, observation model and height scanner.
        """
        rate = self.config.control_rate
        self._schedule = EpisodeSchedule(self.robot, self.scenario, num_envs, self.dt)
        self._action_delay = make_action_delay(self.robot, self.scenario, num_envs, self.dt)
        self._observation_model = make_observation_model(
            equipment.sensors, equipment.estimator, self.simulation, self.scenario, num_envs, rate
        )
        height_scan = _to_setting(options.height_scan)
        self._scanner = make_scanner(height_scan, self.scenario, num_envs, rate)
        self.observation_table = table_with(self.robot, height_scan, self._user_terms)
        """Table of the observation: name, slice, bound and scale of each term."""
        self._rows = np.arange(num_envs)
        self._tracked_command = np.zeros((num_envs, 3))
        """Command that each robot tracked in its last step, (n, 3): forward and lateral m/s, yaw rate rad/s."""

    def _select_equipment(self, options: EnvOptions) -> Equipment:
        """Return actuator, sensors and estimator from the options, or from the robot's hardware profile.

        The hardware profile (realistic motors, sensors and estimator) applies if `Scenario.hardware` is True. In this
        case, ValueError is raised if the options name an actuator, sensors or an estimator, too.
        """
        equipment = Equipment(
            find_actuator(_to_setting(options.actuator)), sensor_suite(_to_setting(options.sensors)), options.estimator
        )
        if self.scenario.hardware:
            if equipment != Equipment(ACTUATORS["ideal"], None, COMPLEMENTARY):
                raise ValueError(
                    f"{self.scenario.name} has the robot's hardware profile: leave out actuator, sensors and "
                    "estimator, or take the scenario without it"
                )
            profile = hardware_profile(self.robot)
            equipment = Equipment(profile.actuator, sensor_suite(profile.sensors), profile.estimator)
        check_estimator(equipment.estimator, equipment.sensors)
        return equipment

    @property
    def estimator(self) -> Estimator | None:
        """Estimator of the observed gravity direction and velocity; None if the observation has the true values."""
        return self._observation_model.estimator

    @property
    def observes_true_state(self) -> bool:
        """True if the observation is the true state, without noise and delay."""
        return self._observation_model.is_exact

    @property
    def severity(self) -> Any:
        """Severity of each robot's scenario, (n,), or a number for one robot; `reset` changes it."""
        return self._schedule.severity

    def moved_scenarios(self, severities: Array | None, mask: Mask) -> dict[int, Scenario]:
        """Return the scenarios at new severities, index of the robot -> scenario.

        ValueError is raised if a severity is not possible in this environment.

        Args:
            severities: New severities, (n,); NaN keeps the present one; None keeps all.
            mask: True for robots to move, (n,).

        Returns:
            Scenario of each robot that moves.
        """
        if severities is None:
            return {}
        has_model_fields = self.simulation.batch.features.package is None  # only MuJoCo itself was compared
        moving = np.flatnonzero(mask & ~np.isnan(severities))
        values = severities[moving].tolist()
        scenarios = {
            value: at_severity(self.scenario, value, self.robot, has_model_fields) for value in dict.fromkeys(values)
        }
        return {int(i): scenarios[value] for i, value in zip(moving, values, strict=True)}

    def _move(self, scenarios: dict[int, Scenario]) -> None:
        """Set the scenarios of some robots for their next episodes, index of the robot -> scenario."""
        self._schedule.set_scenarios(scenarios)
        self._has_moved |= bool(scenarios)

    def _reset_episodes(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Reset simulation, action delay, sensors and height scan of the robots `env_ids` to k new `episodes`."""
        properties = moved_properties(episodes) if self._has_moved else ()
        self.simulation.reset(env_ids, *stack_initial_conditions(episodes), properties)
        for part in (self._action_delay, self._observation_model, self._scanner):
            if part is not None:
                part.reset(env_ids, episodes)
        self._tracked_command[env_ids] = self._schedule.command[env_ids]

    def _advance(self, targets: Array, env_ids: EnvSelection | None) -> StepOutcome[Any]:
        """Advance robots by one control step.

        The phases are action delay, physics, reset of diverged robots, termination, reward, command and observation.

        Args:
            targets: Joint targets of all robots, clipped, (n, 12), rad.
            env_ids: Indices of k robots to advance, or a slice. None means the only robot of a batch of one; the
                results are then floats.

        Returns:
            State, observation, reward terms and termination flags after the step.
        """
        delayed_targets = None
        if self._action_delay is not None:
            moving = ALL if env_ids is None else env_ids
            delayed_targets = self._action_delay.update(targets, self._schedule.step_count[moving], self._rows[moving])
        self._simulate(targets, delayed_targets, env_ids)
        diverged, coordinates = self._reset_diverged(env_ids)
        state = self._compute_state(env_ids, coordinates)
        fall, terminated = self._terminate(state, diverged)
        terms = self._step_terms(state, terminated, diverged)
        self._schedule.resample_commands(env_ids)
        observation = self._observe(state, env_ids)
        return StepOutcome(state, observation, terms, fall, diverged, terminated)

    def _simulate(self, targets: Array, delayed_targets: Array | None, env_ids: EnvSelection | None) -> None:
        """Advance the physics and the step counts of the robots `env_ids` by a control period.

        `targets` are the joint targets of the policies, and `delayed_targets` the targets that the servos receive,
        each (n, 12), rad. If `delayed_targets` is None, the servos receive `targets`. If `env_ids` is None, the batch
        has one robot.
        """
        schedule = self._schedule
        moving = ALL if env_ids is None else env_ids
        self.simulation.step(targets, schedule.push_force(), moving, delayed_targets)
        self._tracked_command[moving] = schedule.command[moving]
        schedule.count_step(env_ids)

    def _reset_diverged(self, env_ids: EnvSelection | None) -> tuple[BoolOrMask, Coordinates[Any]]:
        """Put robots with a diverged simulation into the home pose.

        The states of these robots may contain infinite numbers or NaN; the home pose makes the states finite.

        Args:
            env_ids: Indices of k robots, or a slice; None for the only robot of a batch of one.

        Returns:
            diverged: True for robots with a diverged simulation, (k,), or a bool if `env_ids` is None.
            coordinates: Generalised coordinates of the k robots, which are finite.
        """
        diverged: BoolOrMask
        coordinates, diverged = self.simulation.read_coordinates(env_ids)
        if any_true(diverged):
            rows = self._rows if env_ids is None else self._rows[env_ids]
            self.simulation.reset_diverged(rows[np.atleast_1d(diverged)])
            coordinates, _ = self.simulation.read_coordinates(env_ids)
        return diverged, coordinates

    def _compute_state(
        self, env_ids: EnvSelection | None, coordinates: Coordinates[Any] | None = None
    ) -> QuadState[Any]:
        """Return the present state of the robots `env_ids`, with the velocity command of their last step.

        `coordinates` are the present generalised coordinates of these robots; None to read them.
        """
        command = component_reader(env_ids)(self._tracked_command)
        return self.simulation.state(command, env_ids, coordinates)

    def _terminate(self, state: QuadState[ScalarOrBatch], diverged: BoolOrMask) -> tuple[Any, BoolOrMask]:
        """Return the reasons of falls, and True for robots with an episode that ends in this step.

        A reason is an index into `config.FALL_REASONS`, 0 for no fall. `diverged` is True for robots with a diverged
        simulation.
        """
        fall = where(diverged, 0, fall_reason_code(state, self.config.fall_rule, self._min_trunk_height))
        return fall, diverged | ((fall > 0) & self.terminate_on_fall)

    def _step_terms(
        self, state: QuadState[ScalarOrBatch], terminated: BoolOrMask, diverged: BoolOrMask
    ) -> dict[str, ScalarOrBatch]:
        """Compute mechanical power, overspeed and reward terms of a step: key in the infos -> value.

        The mechanical power has the unit W. Overspeed is the fraction of joints above their rated speed. The reward
        terms are weighted. `terminated` is True for robots with an episode that ends. `diverged` is True for robots
        with a diverged simulation.
        """
        terms = {
            "mechanical_power": state.mechanical_power,
            "overspeed": fraction_above(state.joint_velocity, self.robot.rated_speed),
        }
        terms |= reward_terms(state, terminated, diverged, self._reward_weights)
        for key, term in self._user_rewards.items():
            terms[key] = term.weighted(state, diverged, self.dt)
        return terms

    def _observe(self, state: QuadState[ScalarOrBatch], env_ids: EnvSelection | None) -> NDArray[np.float32]:
        """Return the observation of the robots `env_ids`, (k, size), with the velocity command to track next.

        If `env_ids` is None, the batch has one robot, and the shape is (size,).
        """
        schedule = self._schedule
        rows = self._rows if env_ids is None else self._rows[env_ids]
        clock = schedule.step_count if env_ids is None else schedule.step_count[env_ids]
        command = component_reader(env_ids)(schedule.command)
        observation: NDArray[np.float32] = self._observation_model.observe(state, command, clock, rows)
        if self._scanner is None and not self._user_terms:
            return observation
        further_terms: list[NDArray[np.float32]] = [term.evaluate(state) for term in self._user_terms]
        if self._scanner is not None:
            further_terms.insert(0, self._scanner.scan(state, clock, rows))
        if env_ids is None:
            further_terms = [values[0] for values in further_terms]
        return np.concatenate((observation, *further_terms), axis=-1)

    def close_extras(self, **_: Any) -> None:
        """Close the window or the offscreen renderer, if there is one; a simulation needs no closing."""
        if self._view is not None:
            self._view.close()
            self._view = None


def _to_setting(value: Any) -> Any:
    """Convert a mapping of JSON values to its settings dataclass; return any other value unchanged."""
    return from_json_values(value) if isinstance(value, Mapping) else value


def _check_task_config(config: Any) -> TaskConfig:
    """Return `config`, or the default `TaskConfig` if it is None; raise ValueError for another type."""
    if config is not None and not isinstance(config, TaskConfig):
        raise ValueError(f"config is a quad_env.TaskConfig or None, got {config!r}")
    return config or TaskConfig()


def make_robot(robot: str | Robot, servo: Any, num_envs: int) -> tuple[Robot, Array | None]:
    """Return the robot model with its servo gains, and the servo gains of each robot.

    Args:
        robot: Robot or its name.
        servo: Pair of stiffness and damping; "stiff" for the robot's gains for controllers that need stiff servos; None
            for the robot's usual gains.
        num_envs: Number of robots.

    Returns:
        robot: Robot model with the servo gains; with their mean if the gains of the robots differ.
        gains: Stiffness, N·m/rad, and damping, N·m·s/rad, of each robot, (2, n, 12); None if they do not differ.
    """
    robot = get_robot(robot)
    gains = robot.servo_gains(servo, num_envs)
    differ = bool(np.ptp(gains, axis=1).any())
    return robot.with_servo(*(gains.mean(axis=1) if differ else gains[:, 0])), gains if differ else None
