"""The vector environment: a batch of n robots as one `gymnasium.vector.VectorEnv`."""

from collections.abc import Sequence
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from quad_env import columns
from quad_env.columns import Array, EnvIndices, EnvSelection, Mask, component_reader
from quad_env.envs import arguments
from quad_env.envs.base import STATE_KEYS, EnvKwargs, QuadEnvBase, StepOutcome
from quad_env.physics.simulation import ALL
from quad_env.physics.state import QuadState
from quad_env.scenarios.episode import PushPlan
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.height_scan import UNSEEN, HeightScan, relative_ground_heights
from quad_env.task.observations import observation_table
from quad_env.task.readings import compute_readings

Observation = NDArray[np.float32]
Infos = dict[str, Any]

RENDER_MODES = ("rgb_array",)


class SimpleQuadVectorEnv(QuadEnvBase, VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Batch of n SimpleQuad robots that are stepped together; made by `gym.make_vec`.

    Env i gives the same numbers, bit for bit, as a single env with the same seed, for any n and `nthread`. Every info
    is an array of numbers, (n, ...). For each info `<key>`, the info `_<key>`, (n,), is True for the robots that have
    this info.

    Args:
        num_envs: Number of robots.
        scenario: Name of a scenario with an optional level or severity, or a `quad_env.Scenario`; see `SimpleQuadEnv`.
            `gym.make_vec` also takes a list of scenarios, one for each of equal groups of robots; see
            `ScenarioGroupsVectorEnv`.
        nthread: Number of simulation threads; the results do not depend on this number.
        autoreset_mode: An `AutoresetMode` or its name, `NEXT_STEP`, `SAME_STEP` or `DISABLED`. With `DISABLED` a
            finished robot is not simulated: its last observation is repeated, with zero reward, until
            `reset(options={"reset_mask": mask})`.
        max_episode_steps: Time limit in control steps; None or -1 for no limit.
        terminate_on_fall: True if a fall ends the episode.
        render_mode: None or "rgb_array"; `render` then returns one frame per robot. Only the single environment has a
            window.
        readings: True to add the measurements of `quad_env.task.readings`, which policies do not observe, to the infos.
        **parts: Keyword arguments that configure the robot and the task; `SimpleQuadEnv` describes them.

    Raises:
        ValueError: An argument is invalid.
    """

    SETTABLE: ClassVar = frozenset(("terminate_on_fall", "render_mode", "max_episode_steps"))

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Scenario = "flat",
        nthread: int = 2,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = 1000,
        terminate_on_fall: bool = True,
        render_mode: str | None = None,
        readings: bool = False,
        **parts: Unpack[EnvKwargs],
    ) -> None:
        num_envs = arguments.check_count("num_envs", num_envs)
        nthread = arguments.check_count("nthread", nthread)
        if nthread > arguments.MAX_THREADS:
            raise ValueError(f"nthread is at most {arguments.MAX_THREADS}, got {nthread}")
        max_episode_steps = _check_step_limit(max_episode_steps)
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(f"a batch has no render_mode {render_mode!r}; valid: {', '.join(RENDER_MODES)} or None")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = arguments.parse_autoreset_mode(autoreset_mode)
        spaces = self._build(num_envs, nthread, scenario, readings=readings, visuals=False, **parts)
        self.single_observation_space, self.single_action_space = spaces
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(self.config.control_rate),
            "autoreset_mode": self.autoreset_mode,
        }
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.max_episode_steps = max_episode_steps
        self.terminate_on_fall = terminate_on_fall
        self._has_readings = readings
        self._allocate(num_envs)
        self._made = True

    def _allocate(self, num_envs: int) -> None:
        """Allocate the arrays that hold the results of the last step of all `num_envs` robots.

        A step of some robots writes only the rows of these robots. `reset` and `step` return copies of the arrays.
        """
        self._started = np.zeros(num_envs, bool)
        self._terminated = np.zeros(num_envs, bool)
        self._truncated = np.zeros(num_envs, bool)
        self._diverged = np.zeros(num_envs, bool)
        self._fall = np.zeros(num_envs, np.int8)
        self._observation: Observation = np.zeros((num_envs, self.observation_table.size), np.float32)
        self._heading_velocity = np.zeros((num_envs, 3))
        self._all_true_mask = np.ones(num_envs, bool)
        self._all_true_mask.flags.writeable = False
        self._state: QuadState[Array] | None = None
        """State of all n robots after the last step; None if the last step or reset covered only some robots."""

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Infos]:
        """Start a new episode in every env, or only where `options["reset_mask"]` is True.

        ValueError is raised for an invalid seed, command, severity or mask.

        Args:
            seed: If it is an integer, env i gets the seed `seed` + i; if it is a sequence, env i gets `seed[i]`. None
                keeps the present seed of each env, and starts the next episode that this seed defines.
            options: Dictionary with optional keys. "command", (3,) or (n, 3), is the velocity command of the whole
                episode: forward m/s, lateral m/s, yaw rate rad/s. "reset_mask", (n,) bool, is True for envs to reset.
                "severity", (n,) or a number, is the severity of each env's scenario in this and later episodes, in the
                unit of its axis; NaN keeps the present severity.

        Returns:
            obs: Observations of all robots, (n, size).
            infos: Dictionary, key -> array (n, ...); docs/environment.md lists the keys.
        """
        mask, fixed_command, severities = arguments.parse_reset_options(options, self.num_envs)
        moved_scenarios = self.moved_scenarios(severities, mask)
        self._schedule.reseed(seed, mask)
        self._move(moved_scenarios)
        super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
        self._start_episodes(np.flatnonzero(mask), fixed_command)
        return self._observation.copy(), self._infos(self._zero_terms())

    def step(self, actions: NDArray[np.floating[Any]]) -> tuple[Observation, Array, Mask, Mask, Infos]:
        """Advance by one control period of `dt` seconds.

        ValueError is raised, before any robot moves, if the targets have a wrong shape or are not finite.

        Args:
            actions: Joint targets, (n, 12), rad; targets beyond the joint limits are clipped.

        Returns:
            obs: Observations after the step, (n, size).
            rewards: Sum of the reward terms of each robot, (n,).
            terminated: True for robots that fell, or that have a diverged simulation, (n,).
            truncated: True for robots at the time limit, (n,).
            infos: Dictionary, key -> array (n, ...); docs/environment.md lists the keys.

        Raises:
            ResetNeeded: An env was never reset.
        """
        if not self.has_started:
            raise ResetNeeded("reset the environments before the first step")
        targets = arguments.check_joint_targets(
            actions, (self.num_envs, self.robot.num_joints), self._lower, self._upper
        )
        done = self._terminated | self._truncated
        moving = np.flatnonzero(~done) if done.any() else ALL
        result: StepOutcome[Array] = self._advance(targets, moving)
        self._store(result, moving)
        terms = {key: self._scatter(values, moving) for key, values in result.terms.items()}
        rewards = columns.ordered_sum(map(terms.__getitem__, self._weighted_keys))
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and moving is not ALL:
            self._start_episodes(np.flatnonzero(done), None)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        infos = self._infos(terms)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and (finished := terminated | truncated).any():
            infos = self._restart(finished, infos, terms)
        return self._observation.copy(), rewards, terminated, truncated, infos

    def steer(self, command: ArrayLike) -> None:
        """Set the velocity command that robots track until the next reset; the next observation contains the command.

        ValueError is raised, and the commands stay unchanged, if `command` has a wrong shape, is not finite, or is
        larger than `config.COMMAND_BOUND`.

        Args:
            command: Forward and lateral velocity, heading frame, m/s, and yaw rate, rad/s, (3,) or (n, 3).
        """
        self._schedule.fix_commands(arguments.check_commands(command, self.num_envs, "command"))

    def push(self, force: ArrayLike, duration: float) -> None:
        """Apply a horizontal force to the trunks, in addition to the pushes of the scenario.

        A second call ends the push of the first call. ValueError is raised for a force that has a wrong shape or is not
        finite.

        Args:
            force: Force on the trunk, world frame, (2,) or (n, 2), N.
            duration: Duration of the push, s.

        Raises:
            ValueError: The duration is shorter than a control step.
        """
        steps = round(duration / self.dt) if np.isfinite(duration) else 0
        if steps < 1:
            raise ValueError(f"a push lasts a control step, {self.dt:g} s, or longer, not {duration} s")
        self._schedule.apply_push(arguments.check_rows(force, (self.num_envs, 2), "force"), steps)

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """Return an RGB image of each robot, n times (480, 640, 3) uint8; None if `render_mode` is None."""
        if self.render_mode is None:
            arguments.warn_no_render_mode(RENDER_MODES)
            return None
        if self._view is None:
            from quad_env.physics.rendering import Camera

            self._view = Camera(self.simulation.drawn_model)
        return tuple(self._view.draw(self.simulation.drawn_snapshot(i)) for i in range(self.num_envs))

    def true_observation(self, height_scan: HeightScan | None = None, with_scan_loss: bool = False) -> Observation:
        """Return the observation of the true present state, with the command to track next.

        The values have no noise, delay or estimation error, also if the observation of this environment has them. A
        teacher can act on these values while its student acts on the observation of the environment.

        Args:
            height_scan: Grid of a height scan to append; its rate, delay and noise are not used. None for no scan.
            with_scan_loss: True if points that the height scan of this environment does not show now, because the
                scenario loses the scan or has dropouts of it, read -2 m in the result too.

        Returns:
            Observation, (n, size), as in docs/environment.md.

        Raises:
            ResetNeeded: An env was never reset.
        """
        if not self.has_started:
            raise ResetNeeded("reset the environments before true_observation")
        state: QuadState[Array] = self._compute_state(ALL)
        observation = observation_table(self.robot).observe(state, component_reader(ALL)(self._schedule.command))
        if height_scan is None:
            return observation
        heights = relative_ground_heights(height_scan.points, self.scenario.terrain, state)
        if with_scan_loss and self._scanner is not None:
            self._scanner.loss.hide(heights, height_scan.points, self._schedule.step_count, self._rows)
        return np.concatenate((observation, np.clip(heights, UNSEEN, -UNSEEN).astype(np.float32)), axis=1)

    @property
    def has_started(self) -> bool:
        """True if every env was reset at least once; `step` needs this."""
        return bool(self._started.all())

    @property
    def pushes(self) -> PushPlan:
        """Planned pushes on the trunk in the present episode of every env: start steps, duration and forces."""
        return self._schedule.pushes

    def _start_episodes(self, env_ids: EnvIndices, fixed_commands: Array | None) -> None:
        """Start the next episode of the robots `env_ids`, (k,), and store their first observations.

        `fixed_commands` are the velocity commands of all robots for the whole episode, (n, 3); forward m/s, lateral
        m/s, yaw rate rad/s. If `fixed_commands` is None, the commands are drawn at random.
        """
        if not len(env_ids):
            return
        for flags in (self._terminated, self._truncated, self._diverged):
            flags[env_ids] = False
        self._started[env_ids] = True
        self._fall[env_ids] = 0
        self._state = None
        self._reset_episodes(env_ids, self._schedule.reset(env_ids, fixed_commands))
        state = self._compute_state(env_ids)
        self._store_observation(state, self._observe(state, env_ids), env_ids)

    def _store(self, result: StepOutcome[Array], env_ids: EnvSelection) -> None:
        """Write the `result` of a step of the robots `env_ids` to the stored arrays, and check the time limit."""
        self._state = result.state if env_ids is ALL else None
        self._diverged[env_ids] = result.diverged
        self._fall[env_ids] = result.fall
        self._terminated[env_ids] = result.terminated
        if self.max_episode_steps is not None:
            self._truncated[env_ids] = self._schedule.step_count[env_ids] >= self.max_episode_steps
        self._store_observation(result.state, result.observation, env_ids)

    def _store_observation(self, state: QuadState[Array], observation: Observation, env_ids: EnvSelection) -> None:
        """Write observation and heading velocity of the robots `env_ids` to their rows of the stored arrays."""
        self._heading_velocity[env_ids] = np.transpose(state.heading_velocity)
        self._observation[env_ids] = observation

    def _scatter(self, values: Array, env_ids: EnvSelection) -> Array:
        """Return an array, (n,), with the `values`, (k,), of the robots `env_ids`, and zeros for other robots."""
        if env_ids is ALL:
            return values
        out = np.zeros(self.num_envs)
        out[env_ids] = values
        return out

    def _zero_terms(self) -> Infos:
        """Return zeros, (n,), for the keys of the mechanical power, overspeed and all reward terms in the infos."""
        return {key: np.zeros(self.num_envs) for key in (*STATE_KEYS, *self._reward_keys)}

    def _infos(self, terms: Infos) -> Infos:
        """Return all infos of a step or reset, key -> array (n, ...), with the mask `_<key>` of each key.

        `terms` are the values of mechanical power, overspeed (fraction of joints above their rated speed) and reward
        terms, key -> (n,).
        """
        infos: Infos = {
            "command": self._tracked_command.copy(),
            "heading_velocity": self._heading_velocity.copy(),
            "fall": self._fall.copy(),
            "diverged": self._diverged.copy(),
            **terms,
        }
        if self._has_readings:
            infos |= compute_readings(self.simulation, self._state)
            # The torques are set to zero at the start of an episode, because MuJoCo's torques are from the episode
            # before.
            infos["joint_torque"][self._schedule.step_count == 0] = 0.0
        infos |= self._observation_model.readings()
        return infos | {f"_{key}": self._all_true_mask for key in infos}

    def _restart(self, finished: Mask, infos: Infos, terms: Infos) -> Infos:
        """Start new episodes in the `finished` envs (same-step autoreset), and return the infos of all envs.

        The new keys `final_obs`, (n, size), and `final_info` hold the observations and `infos` at the end of the
        finished episodes. `terms` are the infos of mechanical power, overspeed (fraction of joints above their rated
        speed) and reward terms in the step, key -> (n,); these infos become 0 in the finished envs.
        """
        final = {
            "final_obs": np.where(finished[:, None], self._observation, np.float32(0)),
            "final_info": {key: finished.copy() if key.startswith("_") else value for key, value in infos.items()},
        }
        self._start_episodes(np.flatnonzero(finished), None)
        infos = self._infos({key: np.where(finished, 0.0, values) for key, values in terms.items()})
        return infos | final | {f"_{key}": finished.copy() for key in final}


def _check_step_limit(max_episode_steps: int | None) -> int | None:
    """Check the time limit in control steps, and return it; None if the argument is None or -1 (no limit)."""
    if max_episode_steps is None or max_episode_steps == -1:
        return None
    return arguments.check_count("max_episode_steps, None and -1 for no limit,", max_episode_steps)
