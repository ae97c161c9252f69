"""A view of robots on the same ground: frames by a camera that may be anywhere, fast where a processor draws them."""

import copy
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import NDArray

from quad_env.physics.marks import Mark
from quad_env.physics.rendering import Marker, find_backend

NEAR = 6.0
"""Half-side of the square of a height field that is drawn about the camera's target, m; the whole of one is a million
triangles."""
STRAY = 2.5
"""How far the target may go from that square's centre, m."""
_GEOMS = 2000
"""As many as a scene may have, arrows and marks among them."""


class View:
    """Draws frames of one size; the thread that draws the first may draw the others, and close it.

    Args:
        model: of the simulation that the robots are of; it is not changed.
        fine: with shadows and smooth edges, which cost a processor three to six times as much.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, fine: bool) -> None:
        self._whole, self._model, self._fine = model, copy.copy(model), fine
        quality = self._model.vis.quality
        quality.offsamples = 4 if fine else 0
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        fields = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
        self._field = int(fields[0]) if len(fields) else None
        self._centre: NDArray[np.float64] | None = None
        self._scene, self._marker = mujoco.MjvScene(self._model, _GEOMS), Marker(self._model)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._frame = np.empty((height, width, 3), np.uint8)
        self._window: Any = None
        self._context: mujoco.MjrContext | None = None

    def draw(
        self,
        robots: Sequence[mujoco.MjData],
        *,
        azimuth: float,
        elevation: float,
        distance: float,
        target: tuple[float, float, float],
        marks: Sequence[Mark] = (),
        forces: bool = False,
    ) -> NDArray[np.uint8]:
        """Frame (height, width, 3) of snapshots of the model, shown until the next one is drawn.

        The camera looks at a target, world, m, from a distance, m, in the direction of an azimuth and elevation,
        degrees. With `forces` those of the first robot's contacts are shown. RuntimeError where nothing can be drawn.
        """
        first, *others = robots
        camera, flags, scene, shown = self._camera, self._option.flags, self._scene, mujoco.mjtCatBit.mjCAT_ALL
        camera.azimuth, camera.elevation, camera.distance, camera.lookat[:] = azimuth, elevation, distance, target
        flags[mujoco.mjtVisFlag.mjVIS_CONTACTPOINT] = flags[mujoco.mjtVisFlag.mjVIS_CONTACTFORCE] = forces
        if self._field is not None:
            self._come_near(np.array(target[:2]))
            first.geom_xpos[self._field, :2] = self._centre
        if self._context is None:
            self._open()
        mujoco.mjv_updateScene(self._model, first, self._option, mujoco.MjvPerturb(), camera, shown, scene)
        self._marker.accompany(scene, others)
        self._marker.draw(scene, marks)
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._fine
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._window.make_current()
        mujoco.mjr_render(self._rect, scene, self._context)
        mujoco.mjr_readPixels(self._frame, None, self._rect, self._context)
        return self._frame[::-1]

    def close(self) -> None:
        """Free the GL context."""
        if self._context is not None:
            self._window.make_current()
            self._context.free()
            self._window.free()
            self._context = self._window = None

    def _open(self) -> None:
        find_backend()
        self._window = gl_context.GLContext(self._rect.width, self._rect.height)
        self._window.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def _come_near(self, target: NDArray[np.float64]) -> None:
        """Draw the ground about that point, (2,), m."""
        if self._centre is None or np.abs(target - self._centre).max() > STRAY:
            self._cut(target)
            if self._context is None:  # which is made with it
                return
            self._window.make_current()
            mujoco.mjr_uploadHField(self._model, self._context, int(self._model.geom_dataid[self._field]))

    def _cut(self, target: NDArray[np.float64]) -> None:
        """Have the drawn height field be the square about that point, (2,), m, of the whole one."""
        whole, cut = self._whole, self._model
        field, count = int(whole.geom_dataid[self._field]), int(whole.hfield_nrow[whole.geom_dataid[self._field]])
        half, at = whole.hfield_size[field, 0], whole.geom_pos[self._field, :2]
        spacing = 2.0 * half / (count - 1)
        kept = min(count, 2 * round(NEAR / spacing) + 1)
        first = np.clip(np.round((target - at + half) / spacing).astype(int) - kept // 2, 0, count - kept)
        start = int(whole.hfield_adr[field])
        heights = whole.hfield_data[start : start + count * count].reshape(count, count)  # rows along y
        column, row = first
        part = heights[row : row + kept, column : column + kept]
        cut.hfield_data[start : start + kept * kept] = part.ravel()
        cut.hfield_nrow[field] = cut.hfield_ncol[field] = kept
        cut.hfield_size[field, :2] = spacing * (kept - 1) / 2.0
        self._centre = at - half + spacing * (first + (kept - 1) / 2.0)
