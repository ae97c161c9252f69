"""The native batch: n robots as one `gymnasium.vector.VectorEnv`."""

from collections.abc import Sequence
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from quad_env import columns
from quad_env.columns import Array, EnvIndices, EnvSelection, Mask
from quad_env.envs import arguments
from quad_env.envs.base import EnvKwargs, QuadEnvBase, StepResult
from quad_env.physics.simulation import ALL
from quad_env.physics.state import QuadState
from quad_env.scenarios.episode import PushPlan
from quad_env.scenarios.scenario import Scenario
from quad_env.task.readings import readings as readings_of

Observation = NDArray[np.float32]
Infos = dict[str, Any]

RENDER_MODES = ("rgb_array",)


class SimpleQuadVectorEnv(QuadEnvBase, VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """n SimpleQuad robots, stepped together.

    Env i with a seed gives the same numbers, bit for bit, as a single env with that seed, whatever n and `nthread`.
    Every info is an array of numbers, (n, …), with a mask `_<key>`, (n,), of who has it. Arguments that are not named
    here are those of `SimpleQuadEnv`.

    Args:
        num_envs: number of robots.
        nthread: threads of the simulation.
        autoreset_mode: an `AutoresetMode` or its name, `NEXT_STEP`, `SAME_STEP` or `DISABLED`. With `DISABLED` a
            finished robot stands still in time, its last observation repeated with zero reward, until
            `reset(options={"reset_mask": mask})`.
        max_episode_steps: time limit in control steps; None or -1 for no limit.
        render_mode: None or "rgb_array"; `render` gives a frame a robot. A window shows single ones.
        readings: True adds to the infos what happened in the step beyond what policies observe: see
            `quad_env.task.readings`.
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
        if nthread > arguments.MOST_THREADS:
            raise ValueError(f"nthread is at most {arguments.MOST_THREADS}, got {nthread}")
        max_episode_steps = None if max_episode_steps == -1 else max_episode_steps
        if max_episode_steps is not None:
            max_episode_steps = arguments.check_count("max_episode_steps, None and -1 for no limit,", max_episode_steps)
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(f"a batch has no render_mode {render_mode!r}; valid: {', '.join(RENDER_MODES)} or None")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = arguments.find_autoreset_mode(autoreset_mode)
        spaces = self._build(num_envs, nthread, scenario, readings, **parts)
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
        self._readings = readings
        self._started = np.zeros(num_envs, bool)
        self._terminated, self._truncated = np.zeros(num_envs, bool), np.zeros(num_envs, bool)
        # What the caller is shown copies of: a robot that does not move keeps its row.
        self._observation: Observation = np.zeros((num_envs, self.observation_table.size), np.float32)
        self._heading_velocity = np.zeros((num_envs, 3))
        self._diverged, self._fall = np.zeros(num_envs, bool), np.zeros(num_envs, np.int8)
        self._all_true_mask = np.ones(num_envs, bool)
        self._all_true_mask.flags.writeable = False
        self._state: QuadState[Array] | None = None
        """Of all robots now, where it is known."""
        self._made = True

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Infos]:
        """Start a new episode in every env, or in those of `options["reset_mask"]`.

        Args:
            seed: env i gets seed + i, or the i-th of a sequence; None goes on with each env's next episode.
            options: "command", (3,) or (n, 3), held for the episode; "reset_mask", (n,) bool.

        Raises:
            ValueError: a seed, command or mask of the wrong shape or kind.
        """
        mask, fixed_command = arguments.reset_options(options, self.num_envs)
        self._schedule.reseed(seed, mask)
        super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
        self._start_episodes(np.flatnonzero(mask), fixed_command)
        return self._observation.copy(), self._infos(self._zero_step_terms())

    def step(self, actions: NDArray[np.floating[Any]]) -> tuple[Observation, Array, Mask, Mask, Infos]:
        """Advance by one control period of `dt` seconds.

        Args:
            actions: target joint positions, (n, 12), rad; targets outside the joint limits are clipped.

        Raises:
            ValueError: a wrong shape or a non-finite target; no robot has moved then.
        """
        if not self._started.all():
            raise ResetNeeded("reset the environments before the first step")
        targets = arguments.joint_targets(actions, (self.num_envs, self.robot.num_joints), self._lower, self._upper)
        done = self._terminated | self._truncated
        moving = np.flatnonzero(~done) if done.any() else ALL
        result: StepResult[Array] = self._advance(targets, moving)
        self._store(result, moving)
        terms = {key: self._scatter(values, moving) for key, values in result.terms.items()}
        rewards = columns.ordered_sum(terms[key] for key in self._reward_keys)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and moving is not ALL:
            self._start_episodes(np.flatnonzero(done), None)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        infos = self._infos(terms)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and (finished := terminated | truncated).any():
            infos = self._restart(finished, infos, terms)
        return self._observation.copy(), rewards, terminated, truncated, infos

    def steer(self, command: ArrayLike) -> None:
        """Follow this command, (3,) or (n, 3), from the next step to the next reset: forward and lateral m/s, heading
        frame, yaw rate rad/s. Policies are shown it with the next observation.

        Raises:
            ValueError: a wrong shape, or a command that is not finite or beyond the largest; nothing has changed then.
        """
        self._schedule.fix_commands(arguments.commands(command, self.num_envs, "command"))

    def push(self, force: ArrayLike, duration: float) -> None:
        """Push the trunks with this force, world frame, (2,) or (n, 2), N, for a duration, s, added to the scenario's
        pushes; ends one that is still on.

        Raises:
            ValueError: a wrong shape, a force that is not finite, or a duration below a control step.
        """
        steps = round(duration / self.dt) if np.isfinite(duration) else 0
        if steps < 1:
            raise ValueError(f"a push lasts a control step, {self.dt:g} s, or longer, not {duration} s")
        self._schedule.apply_push(arguments.rows(force, (self.num_envs, 2), "force"), steps)

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """A frame of each robot, (480, 640, 3) uint8; None without a render_mode."""
        if self.render_mode is None:
            arguments.warn_of_no_render_mode(RENDER_MODES)
            return None
        if self._view is None:
            from quad_env.physics.rendering import Camera

            self._view = Camera(self.simulation.model)
        return tuple(self._view.draw(self.simulation.snapshot(i)) for i in range(self.num_envs))

    @property
    def pushes(self) -> PushPlan:
        """The pushes of every env's present episode."""
        return self._schedule.pushes

    def _start_episodes(self, env_ids: EnvIndices, fixed_commands: Array | None) -> None:
        """Start the next episode of the robots `env_ids`; commands of all, (n, 3), or None to draw them."""
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

    def _store(self, result: StepResult[Array], env_ids: EnvSelection) -> None:
        """Store the result of a step of the robots `env_ids`, and whether it is their last within the time limit."""
        self._state = result.state if env_ids is ALL else None
        self._diverged[env_ids] = result.diverged
        self._fall[env_ids] = result.fall
        self._terminated[env_ids] = result.terminated
        if self.max_episode_steps is not None:
            self._truncated[env_ids] = self._schedule.step_count[env_ids] >= self.max_episode_steps
        self._store_observation(result.state, result.observation, env_ids)

    def _store_observation(self, state: QuadState[Array], observation: Observation, env_ids: EnvSelection) -> None:
        """Store the observation and the heading velocity of the robots `env_ids`."""
        self._heading_velocity[env_ids] = np.transpose(state.heading_velocity)
        self._observation[env_ids] = observation

    def _scatter(self, values: Array, env_ids: EnvSelection) -> Array:
        """Return the values of the robots `env_ids` among zeros for the others, (n,)."""
        if env_ids is ALL:
            return values
        out = np.zeros(self.num_envs)
        out[env_ids] = values
        return out

    def _zero_step_terms(self) -> Infos:
        return {key: np.zeros(self.num_envs) for key in ("mechanical_power", "overspeed", *self._reward_keys)}

    def _infos(self, step_terms: Infos) -> Infos:
        infos: Infos = {
            "command": self._tracked_command.copy(),
            "heading_velocity": self._heading_velocity.copy(),
            "fall": self._fall.copy(),
            "diverged": self._diverged.copy(),
            **step_terms,
        }
        if self._readings:
            infos |= readings_of(self.simulation, self._state)
            infos["joint_torque"][self._schedule.step_count == 0] = 0.0  # MuJoCo's is that of another simulation yet
        infos |= self._observation_model.readings()
        return infos | {f"_{key}": self._all_true_mask for key in infos}

    def _restart(self, finished: Mask, infos: Infos, step_terms: Infos) -> Infos:
        """Same-step autoreset: restart the finished envs; the finished step moves to `final_obs` and `final_info`."""
        env_ids = np.flatnonzero(finished)
        extra = {
            "final_obs": np.where(finished[:, None], self._observation, np.float32(0)),
            "final_info": {key: finished.copy() if key.startswith("_") else value for key, value in infos.items()},
        }
        self._start_episodes(env_ids, None)
        infos = self._infos({key: np.where(finished, 0.0, values) for key, values in step_terms.items()})
        return infos | extra | {f"_{key}": finished.copy() for key in extra}
