"""Terrain classes: shape of the ground, its height at a point, and the height of a ball (foot) on it."""

import math
import sys
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from quad_env.columns import Array, ScalarOrBatch, clip, clipped_index, where
from quad_env.config import Bounds, NonNegative, Settings
from quad_env.files.text import one_line
from quad_env.scenarios import height_file
from quad_env.scenarios.height_file import Heights

Length = Annotated[float, Bounds("more than 0 m and at most 1e6 m", sys.float_info.min, 1e6)]
"""Type of a setting that is a positive length of at most 1000 km, m."""
MIN_START_CLEARANCE = 0.7
"""Radius around the trunk's centre in which the ground must be level if a robot starts on stairs, m."""
MAX_GRID_POINTS = 4001
"""Maximum number of grid points of random ground along each side."""


@dataclass(frozen=True)
class Flat(Settings):
    """Level ground, the plane z = 0."""

    spawn_radius: NonNegative = 0.0
    """Half of the side of the square around the origin in which the robots' start position is drawn, m"""

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Return the ground height at a point.

        Args:
            x: X coordinate of the point, world frame, m.
            y: Y coordinate of the point, world frame, m.

        Returns:
            Ground height, world frame, m.
        """
        return 0.0 * x

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Return the centre height of a ball that rests on the ground at a point.

        Args:
            x: X coordinate of the ball's centre, world frame, (n,), m.
            y: Y coordinate of the ball's centre, world frame, (n,), m.
            radius: Radius of the ball, m.

        Returns:
            Height of the ball's centre, world frame, (n,), m.
        """
        return self.height(x, y) + radius


@dataclass(frozen=True)
class Slope(Settings):
    """Infinite plane through the origin that rises along the world's x axis.

    The trunks of the robots are parallel to the plane at the start.
    """

    angle: Annotated[float, Bounds("from 0 to 80° (1.396 rad)", 0.0, math.radians(80.0))] = math.radians(15.0)
    """Angle of the plane above the horizontal, rad"""
    spawn_radius: NonNegative = 0.0
    """Half of the side of the square around the origin in which the robots' start position is drawn, m"""

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Return the ground height at a point.

        Args:
            x: X coordinate of the point, world frame, m.
            y: Y coordinate of the point, world frame, m.

        Returns:
            Ground height, world frame, m.
        """
        return math.tan(self.angle) * x

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Return the centre height of a ball that rests on the ground at a point.

        Args:
            x: X coordinate of the ball's centre, world frame, (n,), m.
            y: Y coordinate of the ball's centre, world frame, (n,), m.
            radius: Radius of the ball, m.

        Returns:
            Height of the ball's centre, world frame, (n,), m.
        """
        return self.height(x, y) + radius / math.cos(self.angle)


@dataclass(frozen=True)
class Stairs(Settings):
    """Stairs that rise towards the world's +x and descend towards −x from a landing at z = 0.

    Each step is a box with a vertical riser, so that the edges of the steps are exact. The ground beyond the last steps
    is level.
    """

    rise: Length = 0.1
    """Height of each step, m"""
    run: Length = 0.3
    """Depth of each step along the world's x axis, m"""
    steps: Annotated[int, Bounds("from 1 to 1000", 1, 1000)] = 60
    """Number of steps in each direction; a robot at the top commanded speed stays on the default stairs for 10 s"""
    landing: float = 0.75
    """Half of the landing's length along the world's x axis, m"""
    half_width: Length = 22.0
    """Half of the width of each step along the world's y axis, m"""
    spawn_radius: NonNegative = 0.0
    """Half of the side of the square around the origin in which the robots' start position is drawn, m"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.landing >= self.spawn_radius + MIN_START_CLEARANCE:
            raise ValueError(f"the landing must be longer than the spawn_radius by {MIN_START_CLEARANCE} m, got {self}")

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Return the ground height at a point; at a riser, the height of the tread of the same step.

        Args:
            x: X coordinate of the point, world frame, m.
            y: Y coordinate of the point, world frame, m.

        Returns:
            Ground height, world frame, m.
        """
        steps = (abs(x) - self.landing) / self.run + 1.0
        climbed = self.rise * clipped_index(clip(steps, 0.0, float(self.steps)), self.steps)
        return cast("ScalarOrBatch", where(x > 0.0, climbed, -climbed))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Return the centre height of a ball that rests on the tread (top of a step) at a point.

        The result is wrong if the horizontal distance from the point to a riser is smaller than the radius.

        Args:
            x: X coordinate of the point, world frame, (n,), m.
            y: Y coordinate of the point, world frame, (n,), m.
            radius: Radius of the ball, m.

        Returns:
            Height of the ball's centre, world frame, (n,), m.
        """
        return self.height(x, y) + radius

    def boxes(self) -> list[tuple[tuple[float, float], float]]:
        """Return a list with the x range and the height of the landing and of each step, world frame, m.

        Each item is ((smallest x, largest x), top height), and becomes a box of the simulation. The level ground at the
        foot of the descending steps has no box.
        """
        low = [-self.landing - k * self.run for k in range(self.steps)]
        high = [self.landing + k * self.run for k in range(self.steps)]
        down = [((low[k], low[k - 1]), -k * self.rise) for k in range(1, self.steps)]
        up = [((high[k - 1], high[k]), k * self.rise) for k in range(1, self.steps)]
        top = ((high[-1], high[-1] + self.half_width), self.steps * self.rise)
        return [((-self.landing, self.landing), 0.0), *down, *up, top]


@dataclass(frozen=True)
class SmoothRandom(Settings):
    """Random uneven ground: a height field of Gaussian-smoothed noise with uniformly distributed heights.

    With uniformly distributed heights, a robot crosses the whole range of heights within a few correlation lengths.
    With Gaussian heights, the field would be nearly flat in most places. The surface lies between z = 0 and
    z = `peak_to_valley`. The ground outside the field is at z = 0.

    All robots of a batch walk on the same field, because MuJoCo stores height data in the model. Episodes differ in the
    start position, which is drawn in a square around the centre; half of its side is `spawn_radius`.
    """

    peak_to_valley: Length = 0.12
    """Height difference between the lowest and the highest point, m"""
    correlation_length: Length = 0.3
    """Distance at which the autocorrelation of the smoothed noise falls to 1/e, m"""
    half_size: Length = 34.0
    """Half of the field's side, m; a robot at the top commanded speed stays on the default field for 10 s"""
    spawn_radius: NonNegative = 16.0
    """Half of the side of the square around the origin in which the robots' start position is drawn, m"""
    cell: Length = 0.1
    """Distance between neighbouring grid points, m"""
    seed: Annotated[int, Bounds("at least 0", 0)] = 0
    """Seed of the random heights, independent of the seeds of the episodes"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spawn_radius > self.half_size or not 2 <= self.points <= MAX_GRID_POINTS:
            valid = f"its spawn_radius inside its half_size, and 2 to {MAX_GRID_POINTS} points"
            raise ValueError(f"a surface has {valid}, got {self}")

    @property
    def points(self) -> int:
        """Number of grid points along each side of the square field."""
        return round(2 * self.half_size / self.cell) + 1

    @property
    def half(self) -> tuple[float, float]:
        """Half of the field's side lengths along x and along y, m."""
        return self.half_size, self.half_size

    @property
    def heights(self) -> Heights:
        """Heights of all grid points of the field: a normalized array, (points, points), with its scale in m.

        Fields that differ only in `peak_to_valley` share one array of normalized heights in memory.
        """
        normalized = _normalized_surface((self.points, self.points), self._kernel_width, self.seed)
        return Heights(normalized, 0.0, self.peak_to_valley)

    @property
    def _kernel_width(self) -> float:
        """Standard deviation of the Gaussian kernel that smooths the noise, in grid cells."""
        return self.correlation_length / 2 / self.cell

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Return the ground height at a point.

        The height is interpolated linearly on two triangles per grid cell, as in the collision detection of MuJoCo.

        Args:
            x: X coordinate of the point, world frame, m.
            y: Y coordinate of the point, world frame, m.

        Returns:
            Ground height, world frame, m; 0 outside the field.
        """
        normalized, _, span = self.heights
        half_x, half_y = self.half
        column = (x + half_x) / self.cell
        row = (y + half_y) / self.cell
        surface = _interpolate_height(normalized, span, column, row)
        inside = (abs(x) <= half_x) & (abs(y) <= half_y)
        return cast("ScalarOrBatch", where(inside, surface, 0.0))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Return the centre height of a ball that rests on the ground at a point.

        If the grid cells are wider than the ball, the ground under the ball is assumed to be level. Otherwise the
        method tests ground points under the ball that are a third of a radius apart.

        Args:
            x: X coordinate of the point, world frame, (n,), m.
            y: Y coordinate of the point, world frame, (n,), m.
            radius: Radius of the ball, m.

        Returns:
            Height of the ball's centre, world frame, (n,), m.
        """
        return self.height(x, y) + radius if self.cell > 2 * radius else _highest_touching(self, x, y, radius)

    def graded(self, max_peak_to_valley: float, ramp: float = 64.0) -> "GradedRandom":
        """Return ground like this one with heights that grow along x, so that a reset can change the severity.

        Args:
            max_peak_to_valley: Range of heights at the rough end, and largest severity, m.
            ramp: Length along x over which the range grows from 0 to the maximum, m.

        Returns:
            The graded ground; an episode starts where its range of heights is `peak_to_valley`.
        """
        settings = {entry.name: getattr(self, entry.name) for entry in fields(SmoothRandom)}
        return GradedRandom(**settings, max_peak_to_valley=max_peak_to_valley, ramp=ramp)


@dataclass(frozen=True)
class GradedRandom(SmoothRandom):
    """Random uneven ground with a range of heights that grows linearly along x, from 0 to a maximum.

    An episode starts where the range of heights is `peak_to_valley`. Robots of a batch share the field, and each may
    have its own `peak_to_valley`. The start position is drawn along y alone. `half_size` is half of the field's side
    along y. Along x, the field has a margin of `half_size` - `spawn_radius` at both ends of the ramp.
    """

    max_peak_to_valley: Length = 0.5
    """Range of heights at the rough end of the ramp, m"""
    ramp: Length = 64.0
    """Length along x over which the range of heights grows from 0 to `max_peak_to_valley`, m"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.peak_to_valley > self.max_peak_to_valley:
            raise ValueError(
                f"GradedRandom.peak_to_valley: more than max_peak_to_valley, got {self.peak_to_valley:g}; "
                f"valid: up to {self.max_peak_to_valley:g}"
            )
        if self.columns > MAX_GRID_POINTS:
            raise ValueError(
                f"GradedRandom.ramp: {self.columns} grid points along x, got {self.ramp:g} m with cells of "
                f"{self.cell:g} m; valid: up to {MAX_GRID_POINTS} grid points"
            )

    @property
    def columns(self) -> int:
        """Number of grid points along x."""
        return round((self.ramp + 2 * (self.half_size - self.spawn_radius)) / self.cell) + 1

    @property
    def half(self) -> tuple[float, float]:
        """Half of the field's side lengths along x and along y, m."""
        return (self.columns - 1) * self.cell / 2, self.half_size

    @property
    def start_x(self) -> float:
        """X coordinate at which the range of heights is `peak_to_valley`, world frame, m."""
        return self.ramp * (self.peak_to_valley / self.max_peak_to_valley - 0.5)

    @property
    def heights(self) -> Heights:
        """Heights of all grid points of the field: a normalized array, (points, columns), with its scale in m.

        Fields that differ only in `peak_to_valley` have the same heights.
        """
        shape = self.points, self.columns
        normalized = _graded_surface(shape, self._kernel_width, self.seed, self.ramp / self.cell)
        return Heights(normalized, 0.0, self.max_peak_to_valley)


@dataclass(frozen=True)
class HeightField(Settings):
    """Terrain of a user: heights on a grid around the world's origin, from a picture or an array.

    The first row of the file, which is the top of a picture, lies at the largest y. The first column, which is the left
    of a picture, lies at the smallest x. The ground around the field is level, at the height of the field's lowest
    point.
    """

    file: str = field(compare=False)
    """Path of a grey picture (.png with 8 or 16 bits), or of an array of rows and columns (.npy)"""
    sha256: str
    """SHA-256 checksum of the file, hexadecimal"""
    size: tuple[Length, Length]
    """Distance between the outermost grid points along x and along y, m"""
    peak: Length | None = None
    """Height that the largest value in the file represents, m; None for an array of heights in m.

    The other values in the file represent heights in proportion, so that the value 0 represents height 0.
    """
    start: tuple[float, float] | None = None
    """Start position of all robots relative to the field's middle, x and y, m; None for random positions."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start is not None and not all(abs(a) <= half for a, half in zip(self.start, self.half, strict=True)):
            raise ValueError(f"{self.file}: robots must start within its {self.size} m, not at {self.start}")

    @classmethod
    def from_toml(cls, path: Path) -> "HeightField":
        """Load the terrain that a TOML file describes.

        Args:
            path: TOML file with the keys `file` and `size`, and optionally `start` and `height`, which sets the field
                `peak`.

        Returns:
            The terrain.

        Raises:
            ValueError: The TOML file or the height file is invalid; the message is one line.
        """
        file, size, height, start = height_file.parse_terrain_toml(path)
        heights_path = str(path.parent / str(file))
        try:
            terrain = cls(heights_path, height_file.sha256_of(heights_path), size, height, start)
        except ValueError as error:
            raise ValueError(one_line(f"{path}: {error}; it wants lines such as {height_file.EXAMPLE_LINES}")) from None
        # The heights are read once here, because a file with invalid heights must raise ValueError when it is loaded.
        height_file.read(heights_path, terrain.sha256, height)
        return terrain

    @property
    def half(self) -> tuple[float, float]:
        """Half of the field's side lengths along x and along y, m."""
        return self.size[0] / 2, self.size[1] / 2

    @property
    def spawn_radius(self) -> float:
        """Half of the side of the square in which the robots' start position is drawn, m.

        The square is in the middle of the field. If `start` is None, the result is half of the distance from the middle
        of the field to its nearest edge. If `start` is given, the result is 0.
        """
        return min(self.half) / 2 if self.start is None else 0.0

    @property
    def heights(self) -> Heights:
        """Heights of all grid points, read from the file; ValueError is raised if the file is missing or changed."""
        return height_file.read(self.file, self.sha256, self.peak)

    def height(self, x: ScalarOrBatch, y: ScalarOrBatch) -> ScalarOrBatch:
        """Return the ground height at a point.

        The height is interpolated linearly on two triangles per grid cell, as in the collision detection of MuJoCo.

        Args:
            x: X coordinate of the point, world frame, m.
            y: Y coordinate of the point, world frame, m.

        Returns:
            Ground height, world frame, m; the field's lowest height outside the field.
        """
        normalized, min_height, span = self.heights
        half_x, half_y = self.half
        rows, columns = normalized.shape
        column = (x + half_x) / self.size[0] * (columns - 1)
        row = (y + half_y) / self.size[1] * (rows - 1)
        inside = (abs(x) <= half_x) & (abs(y) <= half_y)
        surface = _interpolate_height(normalized, span, column, row)
        return cast("ScalarOrBatch", min_height + where(inside, surface, 0.0))

    def sphere_center_height(self, x: Array, y: Array, radius: float) -> Array:
        """Return the centre height of a ball that rests on the ground at a point.

        Args:
            x: X coordinate of the ball's centre, world frame, (n,), m.
            y: Y coordinate of the ball's centre, world frame, (n,), m.
            radius: Radius of the ball, m.

        Returns:
            Height of the ball's centre, world frame, (n,), m.
        """
        return _highest_touching(self, x, y, radius)


def _interpolate_height(grid: Array, span: float, column: ScalarOrBatch, row: ScalarOrBatch) -> ScalarOrBatch:
    """Return the height at a position of a grid, interpolated linearly on two triangles per cell.

    Args:
        grid: Normalized heights of the grid points, 0 to 1, (rows, columns).
        span: Height difference between the normalized heights 0 and 1, m.
        column: Column index of the position, a real number from 0 at the first grid point.
        row: Row index of the position, a real number from 0 at the first grid point.

    Returns:
        Height above the lowest point of the grid, m.
    """
    rows, columns = grid.shape
    column = clip(column, 0.0, float(columns - 1))
    row = clip(row, 0.0, float(rows - 1))
    j = clipped_index(column, columns - 2)
    i = clipped_index(row, rows - 2)
    u = column - j
    v = row - i
    start = span * grid[i, j]
    end = span * grid[i + 1, j + 1]
    side = span * where(u > v, grid[i, j + 1], grid[i + 1, j])
    return cast("ScalarOrBatch", _interpolate_triangle(start, side, end, where(u < v, u, v), where(u < v, v, u)))


def _interpolate_triangle(start: Any, side: Any, end: Any, near: Any, far: Any) -> Any:
    """Interpolate the height linearly in one of the two triangles of a grid cell.

    A position in the cell has two offsets from the cell's first corner, 0 to 1: along the columns and along the rows.
    All heights are in the same unit.

    Args:
        start: Height at the cell's first corner, where both offsets are 0.
        side: Height at the third corner of the triangle, where one offset is 1 and the other is 0.
        end: Height at the corner opposite to the first, where both offsets are 1.
        near: Smaller of the two offsets of the position, 0 to 1.
        far: Larger of the two offsets of the position, 0 to 1.

    Returns:
        Height at the position.
    """
    return start + (side - start) * (far - near) + (end - start) * near


def _highest_touching(terrain: SmoothRandom | HeightField, x: Array, y: Array, radius: float) -> Array:
    """Return the centre height of a ball that rests on uneven ground, world frame, (n,), m.

    The result is the smallest height at which no tested ground point is inside the ball. The tested points under the
    ball are a third of the radius apart. `x` and `y` are the coordinates of the ball's centre in the world frame, (n,),
    m. `radius` is the radius of the ball, m.
    """
    thirds = [(i / 3, j / 3) for i in range(-3, 4) for j in range(-3, 4) if i * i + j * j <= 9]
    touching = [
        terrain.height(x + radius * i, y + radius * j) + radius * math.sqrt(max(0.0, 1 - i * i - j * j))
        for i, j in thirds
    ]
    return np.max(touching, axis=0)  # type: ignore[no-any-return]


@lru_cache(maxsize=16)
def _normalized_surface(shape: tuple[int, int], width: float, seed: int) -> Array:
    """Generate a smooth random surface with uniformly distributed heights from 0 to 1, (rows, columns).

    White noise that is convolved with exp(-2 r²/l²) has the autocorrelation exp(-r²/l²), with the distance r and the
    correlation length l. Then `ndtr`, the cumulative normal distribution function, makes the distribution of the
    heights uniform.

    Args:
        shape: Number of grid points along y and along x.
        width: Standard deviation of the Gaussian kernel, in grid cells: half of the correlation length l.
        seed: Seed of the noise.

    Returns:
        Heights from 0 to 1, dimensionless, a read-only array, (rows, columns).
    """
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtr

    noise = np.random.default_rng(seed).normal(size=shape)
    smooth = gaussian_filter(noise, width, mode="wrap")
    unit: Array = ndtr((smooth - smooth.mean()) / smooth.std())
    unit = (unit - unit.min()) / (unit.max() - unit.min())
    return _in_single_precision(unit)


@lru_cache(maxsize=4)
def _graded_surface(shape: tuple[int, int], width: float, seed: int, ramp: float) -> Array:
    """Generate a smooth random surface with a range of heights that grows along x, from 0 to 1.

    Args:
        shape: Number of grid points along y and along x.
        width: Standard deviation of the Gaussian kernel, in grid cells.
        seed: Seed of the noise.
        ramp: Length of the ramp, in grid cells. The middle of the ramp is the middle of the field.

    Returns:
        Heights from 0 to 1, dimensionless, a read-only array, (rows, columns).
    """
    columns = np.arange(shape[1]) - (shape[1] - 1) / 2
    height_range = np.clip(columns / ramp + 0.5, 0.0, 1.0)
    surface = height_range * _normalized_surface(shape, width, seed)
    # The highest point is 1, because MuJoCo divides the heights by the highest one.
    return _in_single_precision(surface / surface.max())


def _in_single_precision(heights: Array) -> Array:
    """Round heights to single precision, and return them as a read-only array in double precision.

    MuJoCo stores height fields in single precision, and the computed ground heights must equal MuJoCo's.
    """
    grid: Array = heights.astype(np.float32).astype(np.float64)
    grid.flags.writeable = False
    return grid


Terrain = Flat | Slope | Stairs | SmoothRandom | HeightField
