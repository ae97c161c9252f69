"""Frames: their content, supported machines, and invalid arguments."""

import os
import shutil
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import rendering


@pytest.mark.rendering
def test_frames_show_the_robot_where_the_tracking_camera_looks() -> None:
    env = gym.make("SimpleQuad-v0", render_mode="rgb_array")
    env.reset(seed=0)
    frame: Any = env.render()
    assert frame.shape == (480, 640, 3)
    assert frame.dtype == np.uint8
    middle = frame[180:300, 220:420].astype(int)
    assert ((middle[..., 2] > 120) & (middle[..., 0] < 60)).mean() > 0.05  # the trunk is blue
    env.close()


def test_rendering_mistakes_say_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="rgb_array"):
        SimpleQuadEnv(render_mode="ascii")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    env = gym.make("SimpleQuad-v0", render_mode="human").unwrapped
    with pytest.raises(RuntimeError, match="display"):
        env.reset(seed=0)


HUMAN = """
import gymnasium as gym
env = gym.make("quad_env:SimpleQuad-v0", render_mode="human")
env.reset(seed=0)
env.step(env.action_space.sample())
env.close()
print("closed", flush=True)
"""


@pytest.mark.rendering
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs Xvfb")
def test_a_window_opens_on_a_display(display: str) -> None:
    environment = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", HUMAN]
    environment["DISPLAY"] = display
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert (run.returncode, run.stdout) == (0, "closed\n"), run.stderr


IMPORTED_FIRST = """
import os, mujoco
import gymnasium as gym
env = gym.make("quad_env:SimpleQuad-v0", render_mode="rgb_array", width=32, height=24)
env.reset(seed=0)
print("MUJOCO_GL" in os.environ, env.render().std() > 0, mujoco.Renderer(env.unwrapped.model, 24, 32) is not None)
"""


@pytest.mark.rendering
def test_frames_need_no_display_and_no_variable_even_where_mujoco_was_imported_first() -> None:
    """The first frame chooses the backend."""
    if os.environ.get("MUJOCO_GL") != "egl":
        pytest.skip("no EGL here")
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")}
    run = subprocess.run([sys.executable, "-c", IMPORTED_FIRST], env=bare, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "True", "True"]


def test_a_display_and_a_choice_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a display, MuJoCo's own choice applies."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    rendering.select_backend()
    assert "MUJOCO_GL" not in os.environ


@pytest.mark.parametrize("size", [{"height": 0}, {"width": 64.0}, {"height": 100_000}])
def test_a_frame_is_of_whole_pixels(size: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(size))} is a whole number of pixels from 1 to"):
        gym.make("SimpleQuad-v0", render_mode="rgb_array", **size)


@pytest.mark.parametrize("kind", [SimpleQuadEnv, SimpleQuadVectorEnv])
def test_without_a_render_mode_there_is_a_warning_and_no_frame(kind: Any) -> None:
    env = kind()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


@pytest.mark.parametrize("kind", [SimpleQuadEnv, SimpleQuadVectorEnv])
def test_what_could_not_be_made_can_be_closed(kind: Any) -> None:
    """Gymnasium 1.2 closes an environment when it is deleted."""
    env = kind.__new__(kind)
    with pytest.raises(ValueError, match="unknown scenario"):
        env.__init__(scenario="nowhere")
    env.close()
