"""Rendering of a simulated robot: images of an off-screen camera, and an interactive window."""

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

DRAWN_HALF_WIDTH = 6.0
"""Half of the side of the terrain square that is drawn, m.

Only a part of a height field is drawn, because the whole field would have a million triangles.
"""
MAX_TARGET_OFFSET = 2.5
"""Largest distance along x or y from the camera target to the centre of the drawn terrain square, m.

If the distance becomes larger, the square is centred at the target again.
"""


@dataclass(frozen=True)
class Viewpoint:
    """Position of a free camera, in spherical coordinates around the point at which it looks."""

    azimuth: float = 120.0
    """Angle of the viewing direction about the vertical, from the x axis of the world, degrees."""
    elevation: float = -18.0
    """Angle of the viewing direction above the horizontal, degrees; negative if the camera looks down."""
    distance: float = 2.2
    """Distance of the camera from the point at which it looks, m."""
    target: tuple[float, float, float] = (0.0, 0.0, 0.3)
    """Point at which the camera looks, the target, world frame, (3), m."""


class Camera:
    """Off-screen renderer with a camera of the model, or with a free camera that is placed for each image.

    The thread that makes the camera must also call `draw` and `close`. RuntimeError is raised if there is neither a
    display nor EGL.

    Args:
        model: Model of the simulation. A free camera draws a copy of the model, without shadows and anti-aliasing,
            because both make drawing on a processor three to six times slower.
        width: Width of an image, pixels.
        height: Height of an image, pixels.
        camera: Name of a camera of the model; None for a free camera.

    Raises:
        ValueError: The model has no camera of that name.
    """

    def __init__(
        self, model: mujoco.MjModel, width: int = 640, height: int = 480, camera: str | None = "track"
    ) -> None:
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera is not None and camera not in names:
            raise ValueError(f"unknown camera {camera!r}; valid: {', '.join(names)}")
        select_backend()
        self._camera = camera
        self._ground = TerrainPatch(model) if camera is None else None
        if self._ground is not None:
            model = self._ground.model
            model.vis.quality.offsamples = 0
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._size = height, width
        # For a free camera, the first call of `draw` makes the renderer, because the terrain must be cropped first:
        # the upload of the whole terrain to the graphics memory would take seconds.
        self._renderer = None if camera is None else _Renderer(model, *self._size)

    def draw(
        self, data: mujoco.MjData, arrows: Sequence[Arrow | Ball] = (), *, viewpoint: Viewpoint | None = None
    ) -> NDArray[Any]:
        """Draw an RGB image of the robot.

        Args:
            data: MuJoCo data of the robot, from `Simulation.snapshot`.
            arrows: Arrows and balls to draw into the image.
            viewpoint: Position of a free camera; None for the default viewpoint.

        Returns:
            Image, (height, width, 3) uint8.
        """
        camera = self._camera or self._place_free_camera(data, viewpoint or Viewpoint())
        renderer = self._renderer
        assert renderer is not None
        renderer.update_scene(data, camera)
        if self._ground is not None:
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        draw_marks(renderer.scene, arrows)
        return np.array(renderer.render())

    def close(self) -> None:
        """Free the OpenGL context of the renderer."""
        if self._renderer is not None:
            self._renderer.close()

    def _place_free_camera(self, data: mujoco.MjData, viewpoint: Viewpoint) -> mujoco.MjvCamera:
        """Move the drawn terrain square to the target of `viewpoint`, and return the camera at `viewpoint`."""
        assert self._ground is not None
        is_cut = self._ground.recenter(viewpoint.target)
        if self._renderer is None:
            self._renderer = _Renderer(self._ground.model, *self._size)
        elif is_cut:
            self._renderer.upload(self._ground.height_field)
        self._ground.move(data)
        camera = mujoco.MjvCamera()
        camera.azimuth = viewpoint.azimuth
        camera.elevation = viewpoint.elevation
        camera.distance = viewpoint.distance
        camera.lookat[:] = viewpoint.target
        return camera


class TerrainPatch:
    """MuJoCo model in which the height field is cropped to a square around a point, so that it is drawn fast.

    If the model has no height field, the model is not changed.

    Args:
        model: MuJoCo model with the whole height field, which this class copies.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._whole = model
        self.model: mujoco.MjModel = copy.copy(model)
        """Copy of the model with the cropped height field."""
        fields = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
        self._geom = int(fields[0]) if len(fields) else None
        self._centre: NDArray[np.float64] | None = None

    @property
    def height_field(self) -> int:
        """MuJoCo's id of the height field in the model."""
        return int(self.model.geom_dataid[self._geom])

    def recenter(self, target: tuple[float, float, float]) -> bool:
        """Crop the terrain around `target` if `target` is farther than MAX_TARGET_OFFSET from the present centre.

        `target` is a point in the world frame, (3), m. The result is True if the terrain was cropped.
        """
        if self._geom is None:
            return False
        target_xy = np.array(target[:2])
        if self._centre is not None and np.abs(target_xy - self._centre).max() <= MAX_TARGET_OFFSET:
            return False
        self._crop(target_xy)
        return True

    def move(self, data: mujoco.MjData) -> None:
        """Set the position of the cropped terrain in the MuJoCo data `data`, so that it is drawn at the right place."""
        if self._geom is not None:
            data.geom_xpos[self._geom, :2] = self._centre

    def _crop(self, target: NDArray[np.float64]) -> None:
        """Crop the height field around `target`, a point in the world frame, (2), m.

        The rows of the height field run along y, and the columns along x.
        """
        whole = self._whole
        field = self.height_field
        counts = np.array((whole.hfield_ncol[field], whole.hfield_nrow[field]))
        half = whole.hfield_size[field, :2]
        position = whole.geom_pos[self._geom, :2]
        spacing = 2.0 * half / (counts - 1)
        kept = np.minimum(counts, 2 * np.maximum(1, np.round(DRAWN_HALF_WIDTH / spacing).astype(int)) + 1)
        nearest = np.round((target - position + half) / spacing).astype(int)
        first = np.clip(nearest - kept // 2, 0, counts - kept)
        self._write_samples(field, counts, first, kept)
        self.model.hfield_size[field, :2] = spacing * (kept - 1) / 2.0
        self._centre = position - half + spacing * (first + (kept - 1) / 2.0)

    def _write_samples(
        self, field: int, counts: NDArray[np.int_], first: NDArray[np.int_], kept: NDArray[np.int_]
    ) -> None:
        """Copy a rectangle of the whole height field into the cropped height field.

        `first` is the index of the first grid point of the rectangle, and `kept` its number of grid points, each along
        x and y, (2). `counts` are the numbers of grid points of the whole height field, along x and y, (2). `field` is
        MuJoCo's id of the height field.
        """
        whole = self._whole
        cropped = self.model
        start = int(whole.hfield_adr[field])
        heights = whole.hfield_data[start : start + counts.prod()].reshape(counts[::-1])
        column, row = first
        columns, rows = kept
        samples = heights[row : row + rows, column : column + columns]
        cropped.hfield_data[start : start + samples.size] = samples.ravel()
        cropped.hfield_nrow[field] = rows
        cropped.hfield_ncol[field] = columns


class _Renderer(mujoco.Renderer):  # type: ignore[misc]
    """MuJoCo's renderer with a method that updates a changed height field."""

    def upload(self, field: int) -> None:
        """Upload the changed height field with MuJoCo's id `field` from the model to the graphics memory."""
        if self._gl_context:
            self._gl_context.make_current()
        mujoco.mjr_uploadHField(self.model, self._mjr_context, field)


class Window:
    """Interactive window (MuJoCo's passive viewer) that shows the robot; it needs a display.

    Args:
        model: MuJoCo model of the simulation.

    Raises:
        RuntimeError: There is no display.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        if not has_display():
            raise RuntimeError("render_mode='human' needs a display; use 'rgb_array', or start a virtual display")
        from mujoco import viewer

        self._model = model
        self._shown = mujoco.MjData(model)
        other_threads = set(threading.enumerate())
        self._viewer = viewer.launch_passive(model, self._shown, show_left_ui=False, show_right_ui=False)
        self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        self._viewer.cam.trackbodyid = model.body("base_link").id
        self._viewer.cam.distance = 2.5
        self._threads = set(threading.enumerate()) - other_threads

    def draw(self, data: mujoco.MjData) -> None:
        """Show the robot in the state of the MuJoCo data `data`."""
        with self._viewer.lock():
            self._shown.qpos[:] = data.qpos
            self._shown.qvel[:] = data.qvel
            self._shown.time = data.time
            mujoco.mj_forward(self._model, self._shown)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window and wait for its threads, because a process that ends earlier would crash."""
        self._viewer.close()
        for thread in self._threads:
            thread.join()


def has_display() -> bool:
    """Return True if windows can be shown; on Linux, DISPLAY or WAYLAND_DISPLAY must be set."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def select_backend() -> None:
    """Make MuJoCo render with EGL, which needs no display, if there is no display.

    If the environment variable MUJOCO_GL is set, the rendering backend that the variable names is kept. MuJoCo's module
    `gl_context` is reloaded, because the module reads MUJOCO_GL only on import.

    Raises:
        RuntimeError: EGL is not installed.
    """
    if has_display():
        return
    if "MUJOCO_GL" not in os.environ:
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            remedy = "install EGL (Debian: libegl1 libgl1-mesa-dri), or set MUJOCO_GL=osmesa"
            raise RuntimeError(f"nothing can be rendered without a display: {remedy}") from None
        os.environ["MUJOCO_GL"] = "egl"
    importlib.reload(gl_context)
