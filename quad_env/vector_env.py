"""The native batch: n robots as one `gymnasium.vector.VectorEnv`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from quad_env.arguments import (
    check_options,
    find_autoreset_mode,
    held_commands,
    joint_targets,
    reset_mask,
    seeds_of,
)
from quad_env.config import TaskConfig
from quad_env.episode import Episode
from quad_env.observations import BOUND, observe
from quad_env.rewards import reward_terms
from quad_env.robot import JOINT_LOWER, JOINT_UPPER, NUM_JOINTS, VELOCITY_LIMIT
from quad_env.scenarios import Scenario
from quad_env.scenarios import scenario as find_scenario
from quad_env.simulation import Simulation
from quad_env.state import QuadState
from quad_env.terminations import fall_reasons

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Observation = NDArray[np.float32]
Infos = dict[str, Any]

RENDER_MODES = ("rgb_array", "depth_array")
OBSERVATION_SPACE = Box(-BOUND, BOUND, dtype=np.float32)
ACTION_SPACE = Box(JOINT_LOWER.astype(np.float32), JOINT_UPPER.astype(np.float32), dtype=np.float32)


class SimpleQuadVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """n SimpleQuad robots, stepped together.

    Env i with a seed gives the same numbers, bit for bit, as a single env with that seed, whatever n and `nthread`.

    Args:
        num_envs: number of robots.
        scenario: a name from `quad_env.SCENARIOS` or a `quad_env.Scenario`.
        nthread: threads of the simulation.
        autoreset_mode: an `AutoresetMode` or its name, `NEXT_STEP`, `SAME_STEP` or `DISABLED`. With `DISABLED` a
            finished robot stands still in time, its last observation repeated with zero reward, until
            `reset(options={"reset_mask": mask})`.
        max_episode_steps: time limit in control steps of 0.01 s; None or -1 for no limit.
        terminate_on_fall: False keeps a fallen robot going.
        render_mode: None, "rgb_array" or "depth_array"; `render` gives a frame a robot. A window shows single ones.
        config: control rate, fall rule and reward weights.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Scenario = "flat",
        nthread: int = 2,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = 1000,
        terminate_on_fall: bool = True,
        render_mode: str | None = None,
        config: TaskConfig | None = None,
    ) -> None:
        if num_envs < 1 or nthread < 1:
            raise ValueError(f"num_envs and nthread must be at least 1, got {num_envs} and {nthread}")
        max_episode_steps = None if max_episode_steps == -1 else max_episode_steps
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1, or None or -1 for none, got {max_episode_steps}")
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(f"a batch has no render_mode {render_mode!r}; valid: {', '.join(RENDER_MODES)} or None")
        self.scenario = find_scenario(scenario)
        self.config = config or TaskConfig()
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = find_autoreset_mode(autoreset_mode)
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": 100, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = OBSERVATION_SPACE, ACTION_SPACE
        self.observation_space = batch_space(OBSERVATION_SPACE, num_envs)
        self.action_space = batch_space(ACTION_SPACE, num_envs)
        self.max_episode_steps = max_episode_steps
        self.terminate_on_fall = terminate_on_fall
        self.dt = 1 / self.config.control_rate
        self.simulation = Simulation(self.scenario.terrain, num_envs, nthread, self.config.control_rate)
        self._interval = round(self.scenario.commands.interval / self.dt)
        self._seeds = [int(seed) for seed in np.random.SeedSequence().generate_state(num_envs)]
        self._next_episode = np.zeros(num_envs, np.int64)
        self._episodes: list[Episode] = [Episode(self.scenario, 0, 0, self.dt)] * num_envs
        self._clock = np.zeros(num_envs, np.int64)
        self._command, self._held = np.zeros((num_envs, 3)), np.zeros(num_envs, bool)
        self._followed = np.zeros((num_envs, 3))
        self._started = np.zeros(num_envs, bool)
        self._camera: Any = None
        pushes = self._episodes[0].pushes
        self._push_start = np.zeros((num_envs, len(pushes.first_step)), np.int64)
        self._push_force = np.zeros((num_envs, *pushes.force.shape))
        self._push_steps = pushes.steps
        self._terminated, self._truncated = np.zeros(num_envs, bool), np.zeros(num_envs, bool)
        self._diverged, self._fall = np.zeros(num_envs, bool), np.full(num_envs, None, dtype=object)
        self._observation: Observation = np.zeros((num_envs, len(BOUND)), np.float32)

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
        options = options or {}
        check_options(options)
        mask = reset_mask(options.get("reset_mask"), self.num_envs)
        command = options.get("command")
        held = None if command is None else held_commands(command, self.num_envs)
        self._reseed(seed, mask)
        super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
        self._begin(mask, held)
        infos, _ = self._read(np.zeros(self.num_envs, bool), refresh=mask)
        return self._observation.copy(), infos

    def step(self, actions: NDArray[np.floating[Any]]) -> tuple[Observation, Array, Mask, Mask, Infos]:
        """Advance by one control period of `dt` seconds.

        Args:
            actions: target joint positions, (n, 12), rad; targets outside the joint limits are clipped.

        Raises:
            ValueError: a wrong shape or a non-finite target; no robot has moved then.
        """
        if not self._started.all():
            raise ResetNeeded("reset the environments before the first step")
        targets = joint_targets(actions, self.num_envs)
        done = self._terminated | self._truncated
        active = ~done
        self.simulation.step(targets, self._push(), active)
        self._clock[active] += 1
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._begin(done, None)
            infos, rewards = self._read(active, refresh=np.ones(self.num_envs, bool))
        else:
            infos, rewards = self._read(active, refresh=active)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            infos = self._restart_finished(terminated | truncated, infos)
        return self._observation.copy(), rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """A frame of each robot: (480, 640, 3) uint8, or (480, 640) float32 in m; None without a render_mode."""
        if self.render_mode is None:
            return None
        if self._camera is None:
            from quad_env.rendering import Camera

            self._camera = Camera(self.simulation.model)
        depth = self.render_mode == "depth_array"
        return tuple(self._camera.draw(self.simulation.snapshot(i), depth=depth) for i in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Close the renderer."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _reseed(self, seed: int | Sequence[int] | None, mask: Mask) -> None:
        if seed is None:
            return
        seeds = seeds_of(seed, self.num_envs)
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._seeds[i], self._next_episode[i] = seeds[i], 0

    def _begin(self, mask: Mask, held: Array | None) -> None:
        """Start the next episode of the masked envs; `held` are their commands, or None to draw."""
        ids = np.flatnonzero(mask)
        if not len(ids):
            return
        for i in ids:
            episode = Episode(self.scenario, self._seeds[i], int(self._next_episode[i]), self.dt)
            self._episodes[i] = episode
            self._push_start[i], self._push_force[i] = episode.pushes.first_step, episode.pushes.force
            self._command[i] = episode.next_command() if held is None else held[i]
        self._next_episode[ids] += 1
        self._started[ids] = True
        self._clock[ids], self._held[ids] = 0, held is not None
        self._terminated[ids] = self._truncated[ids] = self._diverged[ids] = False
        self._fall[ids] = None
        self.simulation.reset(ids, np.stack([self._episodes[i].start for i in ids]))

    def _push(self) -> Array:
        """Force on each trunk during the coming step, world frame, (n, 2), N."""
        since = self._clock[:, None] - self._push_start
        acting = (since >= 0) & (since < self._push_steps)
        force = np.zeros((self.num_envs, 2))
        for k in range(acting.shape[1]):
            force += np.where(acting[:, k, None], self._push_force[:, k], 0.0)
        return force

    def _read(self, active: Mask, refresh: Mask) -> tuple[Infos, Array]:
        """Infos and rewards of the step that the active envs just took; observations of the envs in `refresh`."""
        diverged = self.simulation.diverged() & active
        self.simulation.park(diverged)
        self._followed[refresh] = self._command[refresh]
        state = self.simulation.state(self._followed.copy())
        self._diverged |= diverged
        reasons = fall_reasons(state, self.config.fall_rule)
        reasons[diverged] = None
        self._fall[active] = reasons[active]
        fell = self._fall.astype(bool)  # a reason is a word, no fall is None
        self._terminated[active] = (diverged | (fell & self.terminate_on_fall))[active]
        if self.max_episode_steps is not None:
            self._truncated[active] = (self._clock >= self.max_episode_steps)[active]
        terms = reward_terms(state, self._terminated, self.config.reward_weights, self.dt)
        paid = active & ~diverged
        terms = {name: np.where(active if name == "fall" else paid, value, 0.0) for name, value in terms.items()}
        self._redraw_commands(active)
        self._observation[refresh] = observe(state, self._command)[refresh]
        rewards = np.zeros(self.num_envs)
        for value in terms.values():
            rewards += value
        return self._infos(state, terms, active), rewards

    def _redraw_commands(self, active: Mask) -> None:
        due = active & ~self._held & (self._clock % self._interval == 0)
        for i in np.flatnonzero(due):
            self._command[i] = self._episodes[i].next_command()

    def _infos(self, state: QuadState, terms: dict[str, Array], active: Mask) -> Infos:
        speed = np.abs(state.joint_velocity)
        power = np.where(active, (np.abs(state.joint_torque) * speed).sum(axis=1), 0.0)
        infos: Infos = {
            "command": state.command,
            "heading_velocity": state.heading_velocity,
            "reward_terms": terms,
            "fall": self._fall.copy(),
            "diverged": self._diverged.copy(),
            "mechanical_power": power,
            "overspeed": np.where(active, (speed > VELOCITY_LIMIT).sum(axis=1) / NUM_JOINTS, 0.0),
        }
        return infos | {f"_{key}": np.ones(self.num_envs, bool) for key in infos}

    def _restart_finished(self, done: Mask, infos: Infos) -> Infos:
        """Same-step autoreset: restart the finished envs; the finished step moves to `final_obs` and `final_info`."""
        if not done.any():
            return infos
        final_observation = np.where(done[:, None], self._observation, np.float32(0))
        final_info = {key: done.copy() if key.startswith("_") else value for key, value in infos.items()}
        self._begin(done, None)
        fresh, _ = self._read(np.zeros(self.num_envs, bool), refresh=done)
        merged = {key: _merge(done, fresh[key], infos[key]) for key in infos}
        extra = {"final_obs": final_observation, "_final_obs": done.copy(), "final_info": final_info}
        return merged | extra | {"_final_info": done.copy()}


def _merge(mask: Mask, chosen: Any, other: Any) -> Any:
    if isinstance(chosen, dict):
        return {key: _merge(mask, chosen[key], other[key]) for key in chosen}
    return np.where(mask.reshape(-1, *[1] * (chosen.ndim - 1)), chosen, other)
