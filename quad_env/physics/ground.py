"""The ground that a free camera draws: a square of the height field, fast where a processor draws it."""

import copy

import mujoco
import numpy as np
from numpy.typing import NDArray

NEAR = 6.0
"""Half-side of the square that is drawn, m; a whole height field is a million triangles."""
STRAY = 2.5
"""Largest distance of the target from the square's centre along an axis, m."""


class Ground:
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

    def come_near(self, target: tuple[float, float, float]) -> bool:
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
        whole, cut, field = self._whole, self.model, self.height_field
        count = int(whole.hfield_nrow[field])
        half, at = whole.hfield_size[field, 0], whole.geom_pos[self._geom, :2]
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
