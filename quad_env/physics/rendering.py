"""Frames and windows of a simulated robot."""

import copy
import ctypes
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import NDArray

from quad_env.physics.arrows import Arrow, Ball, draw_marks

NEAR = 6.0
"""Half-side of the square that is drawn, m; a whole height field is a million triangles."""
STRAY = 2.5
"""Largest distance of the target from the square's centre along an axis, m."""


@dataclass(frozen=True)
class Viewpoint:
    """Place of a free camera: on a sphere about the target."""

    azimuth: float = 120.0
    """Direction in which it looks, about the vertical from world x, degrees."""
    elevation: float = -18.0
    """Above the horizontal, degrees: negative looks down."""
    distance: float = 2.2
    """From the target, m."""
    target: tuple[float, float, float] = (0.0, 0.0, 0.3)
    """World, m."""


class Camera:
    """Off-screen renderer: one of the model's cameras, or without a name a free camera that each frame places.

    The thread that makes it draws with it and closes it.

    Args:
        model: of the simulation; a free camera draws a copy of it, without shadows and smooth edges, which cost a
            processor three to six times as much.

    Raises:
        ValueError: the model has no such camera.
        RuntimeError: nothing can be drawn here.
    """

    def __init__(
        self, model: mujoco.MjModel, width: int = 640, height: int = 480, camera: str | None = "track"
    ) -> None:
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera is not None and camera not in names:
            raise ValueError(f"unknown camera {camera!r}; valid: {', '.join(names)}")
        find_backend()
        self._camera = camera
        self._ground = TerrainPatch(model) if camera is None else None
        if self._ground is not None:
            model = self._ground.model
            model.vis.quality.offsamples = 0
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._size = height, width
        # A free camera's begins with the first frame, once the ground is cut: to load all of it takes seconds.
        self._renderer = None if camera is None else _Renderer(model, *self._size)

    def draw(
        self, data: mujoco.MjData, arrows: Sequence[Arrow | Ball] = (), *, viewpoint: Viewpoint | None = None
    ) -> NDArray[Any]:
        """Frame (height, width, 3) uint8.

        Args:
            data: snapshot of the robot.
            arrows: drawn into the frame, as are balls.
            viewpoint: of a free camera.
        """
        camera = self._camera or self._free(data, viewpoint or Viewpoint())
        renderer = self._renderer
        assert renderer is not None
        renderer.update_scene(data, camera)
        if self._ground is not None:
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        draw_marks(renderer.scene, arrows)
        return np.array(renderer.render())

    def close(self) -> None:
        """Free the GL context."""
        if self._renderer is not None:
            self._renderer.close()

    def _free(self, data: mujoco.MjData, viewpoint: Viewpoint) -> mujoco.MjvCamera:
        """Camera at the viewpoint, with the ground about its target."""
        assert self._ground is not None
        is_cut = self._ground.recenter(viewpoint.target)
        if self._renderer is None:
            self._renderer = _Renderer(self._ground.model, *self._size)
        elif is_cut:
            self._renderer.upload(self._ground.height_field)
        self._ground.move(data)
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = viewpoint.azimuth, viewpoint.elevation
        camera.distance, camera.lookat[:] = viewpoint.distance, viewpoint.target
        return camera


class TerrainPatch:
    """A copy of a model whose height field, if it has one, is cut to a square about a point."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._whole = model
        self.model: mujoco.MjModel = copy.copy(model)
        """The copy."""
        fields = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
        self._geom = int(fields[0]) if len(fields) else None
        self._centre: NDArray[np.float64] | None = None

    @property
    def height_field(self) -> int:
        """Number of the height field in the model."""
        return int(self.model.geom_dataid[self._geom])

    def recenter(self, target: tuple[float, float, float]) -> bool:
        """Cut the square about that point, world, m, where it is too far from the present one; whether it was cut."""
        if self._geom is None:
            return False
        place = np.array(target[:2])
        if self._centre is not None and np.abs(place - self._centre).max() <= STRAY:
            return False
        self._cut(place)
        return True

    def move(self, data: mujoco.MjData) -> None:
        """Put the square where it belongs in a snapshot of the whole model."""
        if self._geom is not None:
            data.geom_xpos[self._geom, :2] = self._centre

    def _cut(self, target: NDArray[np.float64]) -> None:
        """Keep the samples of the height field about that point, world, m: rows lie along y, columns along x."""
        whole, cut, field = self._whole, self.model, self.height_field
        counts = np.array((whole.hfield_ncol[field], whole.hfield_nrow[field]))
        half = whole.hfield_size[field, :2]
        at = whole.geom_pos[self._geom, :2]
        spacing = 2.0 * half / (counts - 1)
        kept = np.minimum(counts, 2 * np.maximum(1, np.round(NEAR / spacing).astype(int)) + 1)
        first = np.clip(np.round((target - at + half) / spacing).astype(int) - kept // 2, 0, counts - kept)
        start = int(whole.hfield_adr[field])
        heights = whole.hfield_data[start : start + counts.prod()].reshape(counts[::-1])
        (column, row), (columns, rows) = first, kept
        part = heights[row : row + rows, column : column + columns]
        cut.hfield_data[start : start + part.size] = part.ravel()
        cut.hfield_nrow[field] = rows
        cut.hfield_ncol[field] = columns
        cut.hfield_size[field, :2] = spacing * (kept - 1) / 2.0
        self._centre = at - half + spacing * (first + (kept - 1) / 2.0)


class _Renderer(mujoco.Renderer):  # type: ignore[misc]
    """MuJoCo's renderer, for models whose height field changes."""

    def upload(self, field: int) -> None:
        """Draw that height field as it is in the model now."""
        if self._gl_context:
            self._gl_context.make_current()
        mujoco.mjr_uploadHField(self.model, self._mjr_context, field)


class Window:
    """MuJoCo's passive viewer; needs a display."""

    def __init__(self, model: mujoco.MjModel) -> None:
        if not shows_windows():
            raise RuntimeError("render_mode='human' needs a display; use 'rgb_array', or start a virtual display")
        from mujoco import viewer

        self._model, self._shown = model, mujoco.MjData(model)
        others = set(threading.enumerate())
        self._viewer = viewer.launch_passive(model, self._shown, show_left_ui=False, show_right_ui=False)
        self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        self._viewer.cam.trackbodyid = model.body("base_link").id
        self._viewer.cam.distance = 2.5
        self._threads = set(threading.enumerate()) - others

    def draw(self, data: mujoco.MjData) -> None:
        """Show the snapshot."""
        with self._viewer.lock():
            self._shown.qpos[:], self._shown.qvel[:], self._shown.time = data.qpos, data.qvel, data.time
            mujoco.mj_forward(self._model, self._shown)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window; its thread has ended then, which otherwise crashes a process that ends before it."""
        self._viewer.close()
        for thread in self._threads:
            thread.join()


def shows_windows() -> bool:
    """Whether there is a display."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def find_backend() -> None:
    """Have MuJoCo draw with EGL where there is no display, unless MUJOCO_GL says otherwise, which it reads only when it
    is imported.

    Raises:
        RuntimeError: there is no EGL.
    """
    if shows_windows():
        return
    if "MUJOCO_GL" not in os.environ:
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            remedy = "install EGL (Debian: libegl1 libgl1-mesa-dri), or set MUJOCO_GL=osmesa"
            raise RuntimeError(f"nothing can be rendered without a display: {remedy}") from None
        os.environ["MUJOCO_GL"] = "egl"
    importlib.reload(gl_context)
