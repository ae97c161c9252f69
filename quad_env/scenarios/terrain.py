"""Terrains as values: the height of the ground under a point, and of the centre of a ball, such as a foot, on it."""

import math
import sys
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, cast

import numpy as np

from quad_env.columns import Array, ScalarOrBatch, clip, clipped_index, where
from quad_env.config import Bounds, NonNegative, Settings
from quad_env.files.text import one_line
from quad_env.scenarios import height_file
from quad_env.scenarios.height_file import Heights

Length = Annotated[float, Bounds("more than 0 m and at most 1e6 m", sys.float_info.min, 1e6)]
MIN_START_CLEARANCE = 0.7
"""m of level ground about the trunk's centre that hold the legs of a starting robot, whatever way it faces."""


@dataclass(frozen=True)
class Flat(Settings):
    """The plane z = 0."""

    spawn_radius: NonNegative = 0.0
    """m, half-side of the square over which robots start"""

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Ground height in the world frame, m."""
        return 0.0 * x

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Centre height of a ball that touches the ground there, world frame, m."""
        return self.height(x, y) + radius


@dataclass(frozen=True)
class Slope(Settings):
    """An infinite plane through the origin that rises along the world's x axis; robots start aligned with it."""

    angle: Annotated[float, Bounds("from 0 to 80° (1.396 rad)", 0.0, math.radians(80.0))] = math.radians(15.0)
    """rad above the horizontal"""
    spawn_radius: NonNegative = 0.0
    """m, half-side of the square over which robots start"""

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Ground height in the world frame, m."""
        return math.tan(self.angle) * x

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Centre height of a ball that touches the ground there, world frame, m."""
        return self.height(x, y) + radius / math.cos(self.angle)


@dataclass(frozen=True)
class Stairs(Settings):
    """Stairs with vertical risers, up towards the world's +x and down towards −x from a landing at z = 0.

    Each step is a box 2·`half_width` wide, so that edges and risers are exact. Beyond the last steps the ground is
    level.
    """

    rise: Length = 0.1
    """m a step"""
    run: Length = 0.3
    """m a step"""
    steps: Annotated[int, Bounds("from 1 to 1000", 1, 1000)] = 60
    """Each way; at the top commanded speed no robot leaves the stairs within 10 s"""
    landing: float = 0.75
    """m, half-length of the landing"""
    half_width: Length = 22.0
    """m"""
    spawn_radius: NonNegative = 0.0
    """m, half-side of the square over which robots start"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.landing >= self.spawn_radius + MIN_START_CLEARANCE:
            raise ValueError(f"the landing must be longer than the spawn_radius by {MIN_START_CLEARANCE} m, got {self}")

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Ground height in the world frame, m; that of the tread right on a riser."""
        steps = (abs(x) - self.landing) / self.run + 1.0
        climbed = self.rise * clipped_index(clip(steps, 0.0, float(self.steps)), self.steps)
        return cast("ScalarOrBatch", where(x > 0.0, climbed, -climbed))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Centre height of a ball on the tread there, world frame, m; of no use within `radius` of a riser."""
        return self.height(x, y) + radius

    def boxes(self) -> list[tuple[tuple[float, float], float]]:
        """Range of x and top z of the landing and each step that is not on the lowest level, m."""
        low = [-self.landing - k * self.run for k in range(self.steps)]
        high = [self.landing + k * self.run for k in range(self.steps)]
        down = [((low[k], low[k - 1]), -k * self.rise) for k in range(1, self.steps)]
        up = [((high[k - 1], high[k]), k * self.rise) for k in range(1, self.steps)]
        top = ((high[-1], high[-1] + self.half_width), self.steps * self.rise)
        return [((-self.landing, self.landing), 0.0), *down, *up, top]


@dataclass(frozen=True)
class SmoothRandom(Settings):
    """Random height field: white noise smoothed by a Gaussian, its heights made uniform between valley and peak.

    Uniform heights let a robot meet the whole range within a few correlation lengths, where a scaled Gaussian field is
    nearly flat about most places. The surface lies between z = 0 and z = `peak_to_valley`; around it the plane z = 0.

    Each episode has a surface of its own: the part of the field about its start, up to `spawn_radius` from the centre,
    since MuJoCo's heights belong to all simulations of a batch.
    """

    peak_to_valley: Length = 0.12
    """m"""
    correlation_length: Length = 0.3
    """m; the autocorrelation of the smoothed noise falls to 1/e at this distance"""
    half_size: Length = 34.0
    """m; at the top commanded speed no robot leaves the field within 10 s"""
    spawn_radius: NonNegative = 16.0
    """m, half-side of the square over which robots start"""
    cell: Length = 0.1
    """m between grid points"""
    seed: Annotated[int, Bounds("at least 0", 0)] = 0
    """The whole field, a set of surfaces, is a function of this seed alone."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spawn_radius > self.half_size or not 2 <= self.points <= 4001:
            raise ValueError(f"a surface has its spawn_radius inside its half_size, and 2 to 4001 points, got {self}")

    @property
    def points(self) -> int:
        """Grid points a side."""
        return round(2 * self.half_size / self.cell) + 1

    @property
    def half(self) -> tuple[float, float]:
        """Half the size along x and y, m."""
        return self.half_size, self.half_size

    @property
    def heights(self) -> Heights:
        """The heights of the whole field; one grid, (points, points), for surfaces that differ in amplitude alone."""
        unit = _unit_surface(self.points, self.correlation_length / 2 / self.cell, self.seed)
        return Heights(unit, 0.0, self.peak_to_valley)

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Surface height at world points, m: linear on the two triangles of each cell, as MuJoCo collides with it."""
        column, row = (x + self.half_size) / self.cell, (y + self.half_size) / self.cell
        surface = _interpolate_height(self.heights.normalized, self.peak_to_valley, column, row)
        inside = (abs(x) <= self.half_size) & (abs(y) <= self.half_size)
        return cast("ScalarOrBatch", where(inside, surface, 0.0))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Centre height of a ball that touches the ground there, world frame, m; cells wider than it are taken for
        level, of finer ground points a third of a radius apart are looked at."""
        return self.height(x, y) + radius if self.cell > 2 * radius else _highest_touching(self, x, y, radius)


@dataclass(frozen=True)
class HeightField(Settings):
    """Ground of a user's own: heights on a grid, from a picture or an array, about the origin of the world.

    The first row of samples, the top of the picture, lies at the largest y, the first column, its left, at the least x.
    Around the field the ground is level, as low as the field's lowest point.
    """

    file: str = field(compare=False)
    """Path of a grey picture, .png of 8 or 16 bit, or of an array of rows and columns, .npy"""
    sha256: str
    """SHA-256 of the file"""
    size: tuple[Length, Length]
    """m along x and y, between the outermost samples"""
    peak: Length | None = None
    """m, height of the largest value, where 0 is height 0; None for an array of heights in m"""
    start: tuple[float, float] | None = None
    """m from the middle along x and y, where all robots start; None for a place drawn by the episode's seed"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start is not None and not all(abs(a) <= half for a, half in zip(self.start, self.half, strict=True)):
            raise ValueError(f"{self.file}: robots must start within its {self.size} m, not at {self.start}")

    @classmethod
    def from_toml(cls, path: Path) -> "HeightField":
        """The ground that a TOML file describes by its `file`, `size`, `height` (the `peak`) and `start`; ValueError,
        one line, for what is none."""
        file, size, height, start = height_file.parse_terrain_toml(path)
        place = str(path.parent / str(file))
        try:
            found = cls(place, height_file.sha256_of(place), size, height, start)
        except ValueError as error:
            raise ValueError(one_line(f"{path}: {error}; it wants lines such as {height_file.EXAMPLE_LINES}")) from None
        height_file.read(place, found.sha256, height)  # raises for what is no ground
        return found

    @property
    def half(self) -> tuple[float, float]:
        """Half the size, m."""
        return self.size[0] / 2, self.size[1] / 2

    @property
    def spawn_radius(self) -> float:
        """Half-side of the square about the middle over which robots start, m: half the shorter way to its edge."""
        return min(self.half) / 2 if self.start is None else 0.0

    @property
    def heights(self) -> Heights:
        """The heights; ValueError, one line, where the file is gone or has changed."""
        return height_file.read(self.file, self.sha256, self.peak)

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Surface height at world points, m: linear on the two triangles of each cell, as MuJoCo collides with it."""
        (unit, lowest, span), (half_x, half_y) = self.heights, self.half
        rows, columns = unit.shape
        column, row = (x + half_x) / self.size[0] * (columns - 1), (y + half_y) / self.size[1] * (rows - 1)
        inside = (abs(x) <= half_x) & (abs(y) <= half_y)
        return cast("ScalarOrBatch", lowest + where(inside, _interpolate_height(unit, span, column, row), 0.0))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Centre height of a ball that touches the ground there, world frame, m."""
        return _highest_touching(self, x, y, radius)


def _interpolate_height(grid: Array, span: float, column: ScalarOrBatch, row: ScalarOrBatch) -> ScalarOrBatch:
    """`span` times the height on the triangles of the grid's cells, at places in cells from its first sample."""
    rows, columns = grid.shape
    column, row = clip(column, 0.0, float(columns - 1)), clip(row, 0.0, float(rows - 1))
    j, i = clipped_index(column, columns - 2), clipped_index(row, rows - 2)
    u, v = column - j, row - i
    near, far = where(u < v, u, v), where(u < v, v, u)
    start, end = span * grid[i, j], span * grid[i + 1, j + 1]
    side = span * where(u > v, grid[i, j + 1], grid[i + 1, j])
    return cast("ScalarOrBatch", start + (side - start) * (far - near) + (end - start) * near)


def _highest_touching(terrain: SmoothRandom | HeightField, x: Array, y: Array, radius: float) -> Array:
    """Least centre height, m, of a ball that is not below any of the points a third of a radius apart under it."""
    thirds = [(i / 3, j / 3) for i in range(-3, 4) for j in range(-3, 4) if i * i + j * j <= 9]
    touching = [
        terrain.height(x + radius * i, y + radius * j) + radius * math.sqrt(max(0.0, 1 - i * i - j * j))
        for i, j in thirds
    ]
    return np.max(touching, axis=0)  # type: ignore[no-any-return]


@lru_cache(maxsize=16)
def _unit_surface(points: int, width: float, seed: int) -> Array:
    """Convolving white noise with exp(-2 r²/l²) gives the autocorrelation exp(-r²/l²); `ndtr` makes it uniform.

    `width` is l/2 in cells.
    """
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtr

    noise = np.random.default_rng(seed).normal(size=(points, points))
    smooth = gaussian_filter(noise, width, mode="wrap")
    unit: Array = ndtr((smooth - smooth.mean()) / smooth.std())
    unit = (unit - unit.min()) / (unit.max() - unit.min())
    # MuJoCo keeps height fields in single precision; both must see the same surface.
    grid: Array = unit.astype(np.float32).astype(np.float64)
    grid.flags.writeable = False
    return grid


Terrain = Flat | Slope | Stairs | SmoothRandom | HeightField
