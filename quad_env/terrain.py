"""Terrains as values, and the height of the ground under a point."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from quad_env.columns import Array, Column, clip, where, whole


@dataclass(frozen=True)
class Flat:
    """The plane z = 0."""

    spawn_radius: float = 0.0
    """m, half-side of the square over which robots start"""

    def height(self, x: Column, y: Column) -> Column:
        """Ground height in the world frame, m."""
        return 0.0 * x


@dataclass(frozen=True)
class SmoothRandom:
    """Random height field: white noise smoothed by a Gaussian, its heights made uniform between valley and peak.

    Uniform heights make the whole peak-to-valley range met within a few correlation lengths, wherever a robot walks;
    scaling the extremes of a large Gaussian field instead would leave the ground around most robots nearly flat. The
    surface lies between z = 0 and z = `peak_to_valley`; around the field the ground is the plane z = 0.
    """

    peak_to_valley: float = 0.12
    """m"""
    correlation_length: float = 0.3
    """m; the autocorrelation of the smoothed noise falls to 1/e at this distance"""
    half_size: float = 22.0
    """m; at the top commanded speed no robot leaves the field within 10 s"""
    spawn_radius: float = 4.0
    """m, half-side of the square over which robots start"""
    cell: float = 0.1
    """m between grid points"""
    seed: int = 0
    """The surface is a function of this seed alone."""

    def __post_init__(self) -> None:
        sizes = (self.peak_to_valley, self.correlation_length, self.half_size, self.cell)
        if not all(0 < size < 1e4 for size in sizes) or not 0 <= self.spawn_radius <= self.half_size:
            raise ValueError(f"a surface needs positive sizes and a spawn_radius inside its half_size, got {self}")
        if self.seed < 0 or not 2 <= self.points <= 4001:
            raise ValueError(f"a surface needs a seed of at least 0 and 2 to 4001 points a side, got {self}")

    @property
    def points(self) -> int:
        """Grid points a side."""
        return round(2 * self.half_size / self.cell) + 1

    def heights(self) -> Array:
        """Grid of heights, rows along y and columns along x, shape (points, points), m."""
        return _smooth_random_heights(self)

    def height(self, x: Column, y: Column) -> Column:
        """Surface height at world points, m: linear on the two triangles of each cell, as MuJoCo collides with it."""
        grid, last = self.heights(), self.points - 1
        column = clip((x + self.half_size) / self.cell, 0.0, float(last))
        row = clip((y + self.half_size) / self.cell, 0.0, float(last))
        j, i = whole(column, last - 1), whole(row, last - 1)
        u, v = column - j, row - i
        near, far = where(u < v, u, v), where(u < v, v, u)
        start, end = grid[i, j], grid[i + 1, j + 1]
        side = where(u > v, grid[i, j + 1], grid[i + 1, j])
        surface = start + (side - start) * (far - near) + (end - start) * near
        inside = (abs(x) <= self.half_size) & (abs(y) <= self.half_size)
        height: Column = where(inside, surface, 0.0)
        return height


@cache
def _smooth_random_heights(terrain: SmoothRandom) -> Array:
    """Convolving white noise with exp(-2 r²/l²) gives the autocorrelation exp(-r²/l²); `ndtr` makes it uniform."""
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtr

    noise = np.random.default_rng(terrain.seed).normal(size=(terrain.points, terrain.points))
    smooth = gaussian_filter(noise, terrain.correlation_length / 2 / terrain.cell, mode="wrap")
    unit: Array = ndtr((smooth - smooth.mean()) / smooth.std())
    unit = (unit - unit.min()) / (unit.max() - unit.min())
    # MuJoCo keeps height fields in single precision; both must see the same surface.
    grid: Array = unit.astype(np.float32).astype(np.float64) * terrain.peak_to_valley
    grid.flags.writeable = False
    return grid


Terrain = Flat | SmoothRandom
