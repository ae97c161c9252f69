"""The single environment: a batch of one."""

from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from quad_env.config import TaskConfig
from quad_env.robot import NUM_JOINTS
from quad_env.scenarios import Scenario

RENDER_MODES = ("rgb_array", "depth_array", "human")


class SimpleQuadEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A 14.2 kg quadruped that follows velocity commands; 12 joint-position targets at 100 Hz.

    Actions, observations, commands, infos, falls and seeds are described in the README, section "Environment". The time
    limit (1000 steps, 10 s) is the `TimeLimit` wrapper that `gym.make` adds.

    Args:
        scenario: a name from `quad_env.SCENARIOS` or a `quad_env.Scenario`.
        terminate_on_fall: False keeps a fallen robot going.
        render_mode: None, "rgb_array", "depth_array" (m from the camera) or "human".
        width, height: of rendered frames, pixels.
        camera: name of a camera of the model.
        config: control rate, fall rule and reward weights.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 100}  # noqa: RUF012 -- typed so by Gymnasium

    def __init__(
        self,
        scenario: str | Scenario = "flat",
        terminate_on_fall: bool = True,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera: str = "track",
        config: TaskConfig | None = None,
    ) -> None:
        from quad_env.vector_env import SimpleQuadVectorEnv

        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"unknown render_mode {render_mode!r}; valid: {', '.join(RENDER_MODES)} or None")
        self._batch = SimpleQuadVectorEnv(
            1,
            scenario,
            nthread=1,
            autoreset_mode=gym.vector.AutoresetMode.DISABLED,
            max_episode_steps=None,
            terminate_on_fall=terminate_on_fall,
            config=config,
        )
        self.render_mode = render_mode
        self.action_space = self._batch.single_action_space
        self.observation_space = self._batch.single_observation_space
        self._frame = (width, height, camera)
        self._view: Any = None

    @property
    def dt(self) -> float:
        """Control period, s."""
        return self._batch.dt

    @property
    def scenario(self) -> Scenario:
        """What the robot has to cope with."""
        return self._batch.scenario

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model; writing to it does not change the simulation."""
        return self._batch.simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """A fresh snapshot of the simulation, derived fields current; writing to it does not change the simulation."""
        return self._batch.simulation.snapshot(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; `options["command"]`, (3,), is held for its whole length."""
        super().reset(seed=seed)
        if options and "reset_mask" in options:
            raise ValueError("options['reset_mask'] is for batches; a single environment always resets")
        observation, infos = self._batch.reset(seed=seed, options=options)
        if self.render_mode == "human":
            self.render()
        return observation[0], _first(infos)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by `dt` seconds with target joint positions (12,), rad.

        Raises:
            ValueError: a wrong shape or a non-finite target; the robot has not moved then.
        """
        if np.shape(action) != (NUM_JOINTS,):
            raise ValueError(f"the action has shape {np.shape(action)}; wanted ({NUM_JOINTS},) joint targets in rad")
        observation, reward, terminated, truncated, infos = self._batch.step(np.asarray(action)[None])
        if self.render_mode == "human":
            self.render()
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(infos)

    def render(self) -> NDArray[Any] | None:
        """The current frame: (height, width, 3) uint8, (height, width) float32 in m, or None for "human"."""
        if self.render_mode is None:
            raise gym.error.Error("render_mode is None; choose one: gym.make('SimpleQuad-v0', render_mode='rgb_array')")
        if self._view is None:
            from quad_env.rendering import Camera, Window

            human = self.render_mode == "human"
            self._view = Window(self.model) if human else Camera(self.model, *self._frame)
        return self._view.draw(self.data, depth=self.render_mode == "depth_array")  # type: ignore[no-any-return]

    def close(self) -> None:
        """Close the window or the renderer; the simulation itself needs no closing."""
        if self._view is not None:
            self._view.close()
            self._view = None


def _first(infos: dict[str, Any]) -> dict[str, Any]:
    """Infos of the only robot of a batch of one."""
    out = {key: value[0] for key, value in infos.items() if key != "reward_terms" and not key.startswith("_")}
    scalars = {key: value.item() for key, value in out.items() if isinstance(value, np.generic)}
    return out | scalars | {"reward_terms": {name: float(value[0]) for name, value in infos["reward_terms"].items()}}
