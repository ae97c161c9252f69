"""Frames and windows of a simulated robot."""

import ctypes
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import NDArray

from quad_env.physics.marks import Arrow, Colour, Ghost, Mark

_SHORTEST = 1e-3
"""m; shorter arrows are not drawn, for they point nowhere."""

_SHADOWLESS = mujoco.mjtCatBit.mjCAT_DECOR
"""Category of what casts no shadow."""


class Camera:
    """Off-screen renderer of one of the model's cameras."""

    def __init__(self, model: mujoco.MjModel, width: int = 640, height: int = 480, camera: str = "track") -> None:
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera not in names:
            raise ValueError(f"unknown camera {camera!r}; valid: {', '.join(names)}")
        if _no_display():
            _render_without_a_display()
        self._camera, self._model = camera, model
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._renderer = mujoco.Renderer(model, height, width)
        self._ghost: mujoco.MjData | None = None

    def draw(self, data: mujoco.MjData, depth: bool = False, marks: Sequence[Mark] = ()) -> NDArray[Any]:
        """Frame (height, width, 3) uint8, or depth (height, width) float32 in m, with these marks in it."""
        (self._renderer.enable_depth_rendering if depth else self._renderer.disable_depth_rendering)()
        self._renderer.update_scene(data, camera=self._camera)
        for mark in marks:
            self._add_arrow(mark) if isinstance(mark, Arrow) else self._add_ghost(mark)
        return np.array(self._renderer.render())

    def _add_arrow(self, arrow: Arrow) -> None:
        start, end = np.array(arrow.start), np.array(arrow.end)
        if np.linalg.norm(end - start) < _SHORTEST:
            return
        scene, kind = self._renderer.scene, mujoco.mjtGeom.mjGEOM_ARROW
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(arrow.colour, np.float32))
        mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
        geom.category = _SHADOWLESS
        scene.ngeom += 1

    def _add_ghost(self, ghost: Ghost) -> None:
        scene, before = self._renderer.scene, self._renderer.scene.ngeom
        if self._ghost is None:
            self._ghost = mujoco.MjData(self._model)
            mujoco.mj_resetDataKeyframe(self._model, self._ghost, self._model.key("home").id)
        self._ghost.qpos[:3] = ghost.position
        mujoco.mju_mat2Quat(self._ghost.qpos[3:7], ghost.rotation.ravel())
        mujoco.mj_kinematics(self._model, self._ghost)
        what = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC
        mujoco.mjv_addGeoms(self._model, self._ghost, *what, scene)
        for geom in scene.geoms[before : scene.ngeom]:
            _paint(geom, ghost.colour)

    def close(self) -> None:
        """Free the GL context."""
        self._renderer.close()


class Window:
    """MuJoCo's passive viewer; needs a display."""

    def __init__(self, model: mujoco.MjModel) -> None:
        if _no_display():
            raise RuntimeError("render_mode='human' needs a display; use 'rgb_array', or start a virtual display")
        from mujoco import viewer

        self._shown = mujoco.MjData(model)
        self._model = model
        self._viewer = viewer.launch_passive(model, self._shown, show_left_ui=False, show_right_ui=False)
        self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        self._viewer.cam.trackbodyid = model.body("base_link").id
        self._viewer.cam.distance = 2.5

    def draw(self, data: mujoco.MjData, depth: bool = False) -> None:
        """Show the snapshot."""
        with self._viewer.lock():
            self._shown.qpos[:], self._shown.qvel[:], self._shown.time = data.qpos, data.qvel, data.time
            mujoco.mj_forward(self._model, self._shown)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()


def _paint(geom: mujoco.MjvGeom, colour: Colour) -> None:
    """In one colour, without the material's texture and gloss, and without a shadow."""
    geom.matid, geom.rgba[:], geom.category = -1, colour, _SHADOWLESS
    geom.specular = geom.shininess = geom.reflectance = 0.0


def _no_display() -> bool:
    return sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _render_without_a_display() -> None:
    """Have MuJoCo use EGL, unless MUJOCO_GL says otherwise; by itself it reads that when it is imported, and only then.

    Raises:
        RuntimeError: there is no EGL.
    """
    if "MUJOCO_GL" not in os.environ:
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            remedy = "install EGL (Debian: libegl1 libgl1-mesa-dri), or set MUJOCO_GL=osmesa"
            raise RuntimeError(f"nothing can be rendered without a display: {remedy}") from None
        os.environ["MUJOCO_GL"] = "egl"
    importlib.reload(gl_context)
