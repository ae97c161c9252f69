"""What all tests share: headless rendering, and property tests that draw the same examples every time."""

import ctypes.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# Same examples on every machine; no deadline, since a shared or slow machine is no fault of the code.
settings.register_profile("simple_quad", derandomize=True, deadline=None, database=None)
settings.load_profile("simple_quad")

# MuJoCo chooses its OpenGL backend once, at import: so before any test module is.
if "MUJOCO_GL" not in os.environ and sys.platform == "linux":
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "osmesa"

RENDER_ONE_PIXEL = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
with mujoco.Renderer(model, 1, 1) as renderer:
    renderer.update_scene(data)
    renderer.render()
"""


def rendering_failure() -> str | None:
    """Why nothing can be rendered here, or None. Asked of another process, since a failing backend may abort it."""
    probe = subprocess.run([sys.executable, "-c", RENDER_ONE_PIXEL], capture_output=True, text=True, check=False)
    if probe.returncode == 0:
        return None
    return (probe.stderr.strip().splitlines() or [f"exit code {probe.returncode}"])[-1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests marked `rendering` are skipped where no OpenGL backend can be loaded, and only there."""
    marked = [item for item in items if item.get_closest_marker("rendering")]
    if marked and (failure := rendering_failure()):
        backend = os.environ.get("MUJOCO_GL", "glfw")
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=f"no OpenGL: MUJOCO_GL={backend}: {failure}"))


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the clone."""
    return Path(__file__).parents[1]
