"""Frames and windows of a simulated robot."""

import ctypes
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import NDArray

from quad_env.physics.marks import Arrow, Ball, Colour, Ghost, Mark

COMPANIONS: tuple[Colour, ...] = ((0.95, 0.55, 0.1, 1.0), (0.3, 0.75, 0.35, 1.0), (0.75, 0.35, 0.8, 1.0))
"""Colours of the second robot of a scene, the third and so on."""
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
        find_backend()
        self._camera = camera
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._renderer = mujoco.Renderer(model, height, width)
        self._marker = Marker(model)

    def draw(self, data: mujoco.MjData, depth: bool = False, marks: Sequence[Mark] = ()) -> NDArray[Any]:
        """Frame (height, width, 3) uint8, or depth (height, width) float32 in m, with these marks in it."""
        (self._renderer.enable_depth_rendering if depth else self._renderer.disable_depth_rendering)()
        self._renderer.update_scene(data, camera=self._camera)
        self._marker.draw(self._renderer.scene, marks)
        return np.array(self._renderer.render())

    def close(self) -> None:
        """Free the GL context."""
        self._renderer.close()


class Marker:
    """Adds marks to scenes of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._ghost: mujoco.MjData | None = None

    def draw(self, scene: mujoco.MjvScene, marks: Sequence[Mark]) -> None:
        """Add them."""
        for mark in marks:
            if isinstance(mark, Arrow):
                _add_arrow(scene, mark)
            elif isinstance(mark, Ball):
                _add_ball(scene, mark)
            else:
                self._add_ghost(scene, mark)

    def accompany(self, scene: mujoco.MjvScene, robots: Sequence[mujoco.MjData]) -> None:
        """Add robots of the same model, each in one of `COMPANIONS`."""
        what = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC
        for robot, colour in zip(robots, COMPANIONS, strict=False):
            before = scene.ngeom
            mujoco.mjv_addGeoms(self._model, robot, *what, scene)
            for geom in scene.geoms[before : scene.ngeom]:
                _paint(geom, colour)

    def _add_ghost(self, scene: mujoco.MjvScene, ghost: Ghost) -> None:
        before = scene.ngeom
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


class Window:
    """MuJoCo's passive viewer; needs a display.

    Args:
        on_key: told GLFW's code of every key that is pressed in it, in a thread of the viewer.
    """

    def __init__(self, model: mujoco.MjModel, on_key: Callable[[int], None] | None = None) -> None:
        if not shows_windows():
            raise RuntimeError("render_mode='human' needs a display; use 'rgb_array', or start a virtual display")
        from mujoco import viewer

        self._shown = mujoco.MjData(model)
        self._model, self._marker = model, Marker(model)
        look = {"show_left_ui": False, "show_right_ui": False, "key_callback": on_key}
        self._viewer = viewer.launch_passive(model, self._shown, **look)
        self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        self._viewer.cam.trackbodyid = model.body("base_link").id
        self._viewer.cam.distance = 2.5

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return bool(self._viewer.is_running())

    def draw(
        self,
        data: mujoco.MjData,
        depth: bool = False,
        others: Sequence[mujoco.MjData] = (),
        marks: Sequence[Mark] = (),
        text: str = "",
    ) -> None:
        """Show the snapshot, other robots in colours of their own, marks, and a text in the corner."""
        with self._viewer.lock():
            self._shown.qpos[:], self._shown.qvel[:], self._shown.time = data.qpos, data.qvel, data.time
            mujoco.mj_forward(self._model, self._shown)
            if (scene := self._viewer.user_scn) is not None:
                scene.ngeom = 0
                self._marker.accompany(scene, others)
                self._marker.draw(scene, marks)
        if text:
            corner = mujoco.mjtGridPos.mjGRID_TOPLEFT
            self._viewer.set_texts((mujoco.mjtFontScale.mjFONTSCALE_100, corner, text, ""))
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()


def _add_arrow(scene: mujoco.MjvScene, arrow: Arrow) -> None:
    start, end = np.array(arrow.start), np.array(arrow.end)
    if np.linalg.norm(end - start) < _SHORTEST:
        return
    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(arrow.colour, np.float32))
    mujoco.mjv_connector(geom, kind, arrow.radius, start, end)
    geom.size[2] *= 2.0  # of which MuJoCo draws half
    geom.category = _SHADOWLESS
    scene.ngeom += 1


def _add_ball(scene: mujoco.MjvScene, ball: Ball) -> None:
    geom, size = scene.geoms[scene.ngeom], np.full(3, ball.radius)
    colour = np.array(ball.colour, np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, np.array(ball.centre), np.eye(3).ravel(), colour)
    geom.category = _SHADOWLESS
    scene.ngeom += 1


def _paint(geom: mujoco.MjvGeom, colour: Colour) -> None:
    """In one colour, without the material's texture and gloss, and without a shadow."""
    geom.matid, geom.rgba[:], geom.category = -1, colour, _SHADOWLESS
    geom.specular = geom.shininess = geom.reflectance = 0.0


def shows_windows() -> bool:
    """Whether there is a display."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def find_backend() -> None:
    """Have MuJoCo draw without a display where there is none. Raises RuntimeError where nothing can be drawn then."""
    if not shows_windows():
        _render_without_a_display()


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
