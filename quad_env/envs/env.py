"""The single environment of one robot, which computes with Python floats, because they are faster than arrays."""

from dataclasses import dataclass
from typing import Any, ClassVar, Unpack

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from quad_env import columns
from quad_env.config import FALL_REASONS
from quad_env.envs.arguments import check_frame, check_joint_targets, parse_reset_options, warn_no_render_mode
from quad_env.envs.base import STATE_KEYS, EnvKwargs, QuadEnvBase, StepOutcome
from quad_env.envs.vector_env import Observation
from quad_env.physics.state import QuadState
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import assign_seeds

RENDER_MODES = ("rgb_array", "human")
_FALL_CODES = tuple(np.int8(code) for code in range(len(FALL_REASONS)))
"""Code of each fall reason as an info; an info has a NumPy type."""


@dataclass(slots=True)
class _Status:
    """Status of the episode; not attributes of the environment, because these are checked at each assignment."""

    started: bool = False
    """True after the first reset of the environment."""
    fall: int = 0
    """Index of the reason of the fall in `config.FALL_REASONS`; 0 for no fall."""
    diverged: bool = False
    """True if the simulation has diverged."""
    terminated: bool = False
    """True if the episode has ended by a fall or a diverged simulation."""


class SimpleQuadEnv(QuadEnvBase, gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A 14.2 kg quadruped that tracks velocity commands with 12 joint-position targets at 100 Hz.

    Action: joint targets, rad, in the order of `quad_env.JOINT_NAMES`, clipped to the joint limits.

    Observation, see `quad_env.OBSERVATION` for the slices:

    ====================  =====  =========================================================
    projected_gravity     3      unit vector, base frame
    angular_velocity      3      rad/s, base frame
    linear_velocity       3      m/s, base frame
    joint_position        12     rad, minus the home pose
    joint_velocity        12     rad/s
    previous_action       12     rad, as clipped, minus the home pose
    command               3      forward m/s, lateral m/s, yaw rate rad/s
    ====================  =====  =========================================================

    docs/environment.md describes infos, falls, rewards, seeds and all changes since the first registration. Every info
    is a number or an array of numbers. `gym.make` adds the time limit (1000 steps, 10 s) as a `TimeLimit` wrapper.

    Keyword Args:
        config: A `quad_env.TaskConfig` with control rate, fall rule and reward weights; None for the defaults.
        rewards: Additional reward terms, name -> (function, weight), or name -> weight for a term of an extension; see
            docs/extending.md.
        observations: Additional observation terms, at the end of the observation: `quad_env.ObservationTerm`, or names
            of terms of an extension. The terms are computed from the true state.
        actuator: A name from `quad_env.ACTUATORS` or a `quad_env.Actuator`.
        sensors: Source of the observation: None or "truth" for the true state, a name from `quad_env.SENSORS`, or a
            `quad_env.SensorSuite`. Each simulated sensor adds two keys to the infos: `sensor_<name>` is the reading,
            and `sensor_<name>_time` is the time of the measurement since the start of the episode, s.
        robot: The simulated `quad_env.Robot`, or its name in `quad_env.ROBOTS`.
        estimator: Estimator of gravity and velocity from the sensors' readings: a name from `quad_env.ESTIMATORS`.
        height_scan: The `quad_env.HeightScan` to add to the observation as the term `height_scan`; None for no scan.
        servo: Pair of stiffness, N·m/rad, and damping, N·m·s/rad, of the joint servos. Each is a number, or (12,) in
            the order of the joints; a batch also accepts (n, 12). "stiff" for the robot's gains for controllers that
            need stiff servos, None for the gains of the robot's model. Pass the same `servo` to `policies.make`.
        simulator: Name of the physics engine. "mujoco" is the default. "drake" supports ideal motors and level ground,
            slopes and stairs, see docs/second-simulator.md. "warp" is MuJoCo Warp for training, see docs/training.md.

    Args:
        scenario: A `quad_env.Scenario`, a name from `quad_env.SCENARIOS`, or a disturbance with a level or a severity,
            for example `push:3` (level 3), `push=42` (severity 42) or `payload=15+slope=10` (two severities).
        terminate_on_fall: True if a fall ends the episode.
        render_mode: None, "rgb_array" or "human".
        width: Width of rendered frames, pixels.
        height: Height of rendered frames, pixels.
        camera: Name of a camera of the model.
        **parts: Keyword arguments that configure the robot and the task, listed above.

    Raises:
        ValueError: An argument is invalid.
    """

    SETTABLE: ClassVar = frozenset(("terminate_on_fall", "render_mode"))
    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 100}  # noqa: RUF012 -- typed so by Gymnasium

    def __init__(
        self,
        scenario: str | Scenario = "flat",
        terminate_on_fall: bool = True,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera: str = "track",
        **parts: Unpack[EnvKwargs],
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"unknown render_mode {render_mode!r}; valid: {', '.join(RENDER_MODES)} or None")
        check_frame(width, height)
        self.observation_space, self.action_space = self._build(1, 1, scenario, readings=False, visuals=True, **parts)
        self.metadata = self.metadata | {"render_fps": round(self.config.control_rate)}
        self.terminate_on_fall = terminate_on_fall
        self.render_mode = render_mode
        self._status = _Status()
        self._frame = (width, height, camera)
        self._zero_terms = dict.fromkeys((*STATE_KEYS, *self._reward_keys), np.float64(0.0))
        self._computed_keys = (*STATE_KEYS, *self._weighted_keys)
        """Keys of the terms in the infos that are not always 0."""
        self._made = True

    @property
    def model(self) -> mujoco.MjModel:
        """Compiled MuJoCo model of the robot and the terrain; writing to it does not change the simulation."""
        return self.simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """New copy of the MuJoCo data at the present state; writing to it does not change the simulation."""
        return self.simulation.snapshot(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed that defines this and the following episodes. None keeps the present seed, and starts the next
                episode that this seed defines.
            options: Dictionary with two optional keys. "command", (3,), is the velocity command of the whole episode:
                forward m/s, lateral m/s, yaw rate rad/s; by default, commands are drawn at random. "severity" is the
                severity of the scenario in this and later episodes, in the unit of its axis.

        Returns:
            obs: First observation, (size,).
            info: Dictionary, key -> number or array; docs/environment.md lists the keys.

        Raises:
            ValueError: The seed, command or severity is invalid, or the options have a `reset_mask`.
        """
        mask, fixed_command, severities = parse_reset_options(options, 1)
        seed = None if seed is None else assign_seeds([seed], 1)[0]
        super().reset(seed=seed)
        if "reset_mask" in (options or ()):
            raise ValueError("options['reset_mask'] is for batches; a single environment always resets")
        moved_scenarios = self.moved_scenarios(severities, mask)
        self._schedule.reseed(seed, mask)
        self._move(moved_scenarios)
        self._reset_episodes(self._rows, self._schedule.reset(self._rows, fixed_command))
        self._status = _Status(started=True)
        self.simulation.sync_model(0)
        observation, info = self._current_observation()
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action: NDArray[np.floating[Any]]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one control period.

        After a termination, the robot is not simulated until `reset`, and the reward is 0. ValueError is raised, before
        the robot moves, if the targets have a wrong shape or are not finite.

        Args:
            action: Joint targets, (12,), rad; targets beyond the joint limits are clipped.

        Returns:
            obs: Observation after the step, (size,).
            reward: Sum of the reward terms.
            terminated: True if the robot fell, or if its simulation diverged.
            truncated: Always False, because the `TimeLimit` wrapper handles the time limit.
            info: Dictionary, key -> number or array; docs/environment.md lists the keys.

        Raises:
            ResetNeeded: The environment was never reset.
        """
        targets = check_joint_targets(action, self._lower.shape, self._lower, self._upper)
        status = self._status
        if not status.started:
            raise ResetNeeded("reset the environment before the first step")
        if status.terminated:
            observation, info = self._current_observation()
            return observation, 0.0, True, False, info
        result: StepOutcome[float] = self._advance(targets[None], None)
        status.fall = result.fall
        status.diverged = bool(result.diverged)
        status.terminated = bool(result.terminated)
        reward = columns.ordered_sum(map(result.terms.__getitem__, self._weighted_keys))
        if self.render_mode == "human":
            self.render()
        return result.observation, reward, status.terminated, False, self._info(result.state, result.terms)

    def _current_observation(self) -> tuple[Observation, dict[str, Any]]:
        """Return the observation and the info of the present state; all reward terms in the info are 0."""
        state: QuadState[float] = self._compute_state(None)
        terms = dict.fromkeys(self._computed_keys, 0.0)
        return self._observe(state, None), self._info(state, terms)

    def _info(self, state: QuadState[float], terms: dict[str, float]) -> dict[str, Any]:
        """Return the info of a step or reset, key -> number or array.

        `terms` are the values of mechanical power, W, overspeed (fraction of joints above their rated speed) and reward
        terms, key -> value.
        """
        info: dict[str, Any] = {
            "command": np.array(state.command),
            "heading_velocity": np.array(state.heading_velocity),
            "fall": _FALL_CODES[self._status.fall],
            # The bool becomes an array, because Gymnasium's vector envs collect `np.bool_` in an array of objects.
            "diverged": np.array(self._status.diverged),
            **self._zero_terms,
        }
        for key in self._computed_keys:
            info[key] = np.float64(terms[key])
        for key, values in self._observation_model.readings().items():
            info[key] = values[0]
        return info

    def render(self) -> NDArray[Any] | None:
        """Return an RGB image, (height, width, 3) uint8; None if `render_mode` is "human" or None.

        The mode "human" shows the image in a window instead.
        """
        if self.render_mode is None:
            warn_no_render_mode(RENDER_MODES)
            return None
        if self._view is None:
            from quad_env.physics.rendering import Camera, Window

            human = self.render_mode == "human"
            self._view = Window(self.model) if human else Camera(self.model, *self._frame)
        return self._view.draw(self.data)  # type: ignore[no-any-return]

    def close(self) -> None:
        """Close the window or the offscreen renderer of the environment."""
        self.close_extras()
