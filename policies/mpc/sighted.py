"""Model-predictive controller that reads ground heights under footholds and swings from a height scan."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions
from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats, smoothstep
from policies.memory import lowpass_gain, per_robot
from policies.mpc.footing import MAX_SLOPE, Terrain, TerrainPlane
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from policies.mpc.reading_noise import NoiseEstimator
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import EnvIndices, Mask
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import UNSEEN, HeightScan, table_with

SCAN = HeightScan(ahead=14, behind=14, aside=10, spacing=0.05)
"""Default grid of the height scan: 29 x 21 points at a spacing of 0.05 m about the trunk."""
PLANE_FILTER_TIME = 0.1
"""Time constant of the low-pass filter of the ground plane to which the trunk is kept parallel, s."""
NOISE_FLOOR_STD = 0.02
"""Noise floor: standard deviation estimated for a noise-free scan of terrain with steps, m."""
SWING_SAMPLES = (0.25, 0.5, 0.75)
"""Points on the way of a swing foot at which the terrain height is read, as fractions of the way to the foothold."""
PLANE_FIT_HALF_SIZE = (0.45, 0.4)
"""Half-length and half-width of the rectangle about the trunk in which the ground plane is fitted, m."""
_EDGE = 1e-9
"""Tolerance for rounding errors of a position, m; also the smallest variance that a variance is divided by, m²."""


class ScannedTerrain(NamedTuple):
    """Terrain heights on a grid about n robots, level frame."""

    scan: HeightScan
    """Grid of the height scan: number and spacing of its points."""
    heights: Floats
    """Height of the centre of a foot that stands on each grid point, relative to the trunk centre.

    Shape (n, rows, columns), m; rows run forward and columns to the left."""

    def at(self, positions: Floats) -> Floats:
        """Return the terrain heights at four positions per robot, by bilinear interpolation.

        A position outside of the grid has the height of the nearest point on the edge.

        Args:
            positions: Positions (x, y), level frame, (n, 4, 2), m.

        Returns:
            Heights, level frame, (n, 4), m.
        """
        _, num_rows, num_columns = self.heights.shape
        row = _locate(positions[..., 0] / self.scan.spacing + self.scan.behind, num_rows)
        column = _locate(positions[..., 1] / self.scan.spacing + self.scan.aside, num_columns)
        height = self._in_row(row.lower, column)
        next_height = self._in_row(row.upper, column)
        interpolated: Floats = (1.0 - row.fraction) * height + row.fraction * next_height
        return interpolated

    def _in_row(self, row: EnvIndices, column: "GridCell") -> Floats:
        """Return the heights in grid rows, (n, 4), m, by linear interpolation between two columns.

        `row`: indices of the rows, (n, 4); `column`: the two columns and the position between them.
        """
        robot = np.arange(len(row))[:, None]
        height = self.heights[robot, row, column.lower]
        next_height = self.heights[robot, row, column.upper]
        interpolated: Floats = (1.0 - column.fraction) * height + column.fraction * next_height
        return interpolated


class GridCell(NamedTuple):
    """Two neighbouring grid points on one axis and the position of each foot between them."""

    lower: EnvIndices
    """Index of the grid point before the foot, (n, 4)."""
    upper: EnvIndices
    """Index of the grid point after the foot, (n, 4); equal to `lower` at the end of the axis."""
    fraction: Floats
    """Position of the foot between the grid points `lower` (0) and `upper` (1), (n, 4)."""


def _locate(coordinate: Floats, count: int) -> GridCell:
    """Return the grid points around a `coordinate`, (n, 4), in grid steps; the axis has `count` points."""
    clipped = np.clip(coordinate, 0.0, count - 1.0)
    index = clipped.astype(np.intp)
    return GridCell(index, np.minimum(index + 1, count - 1), clipped - index)


@cache
def plane_fit_weights(scan: HeightScan) -> Floats:
    """Return the weights of a least-squares fit of a plane to the heights on a grid.

    Each parameter of the plane is the sum of weight × height over the grid points within `PLANE_FIT_HALF_SIZE`.

    Args:
        scan: Grid of the height scan.

    Returns:
        Weights of three parameters, (3, rows, columns): height under the trunk centre, slope forward and slope to the
        left.
    """
    x, y = np.moveaxis(scan.grid, -1, 0)
    half_length, half_width = PLANE_FIT_HALF_SIZE
    is_near = (np.abs(x) <= half_length + _EDGE) & (np.abs(y) <= half_width + _EDGE)
    weights = np.zeros((3, *x.shape))
    weights[:, is_near] = np.linalg.pinv(np.stack((np.ones(is_near.sum()), x[is_near], y[is_near]), axis=-1))
    return weights


def make_scanned_terrain(
    scan: HeightScan, readings: Floats, ground: TerrainPlane, foot_radius: float
) -> ScannedTerrain:
    """Make the terrain of n robots from the readings of their height scans.

    Args:
        scan: Grid of the height scan.
        readings: Scanned heights of the ground at the p grid points, relative to the trunk centre, (n, p), m.
        ground: Plane through the footprints. It gives the height at points for which the scan has no reading.
        foot_radius: Radius of a foot, m. It is added to the readings, because a `ScannedTerrain` has the heights of
            foot centres.

    Returns:
        Terrain of n robots.
    """
    plane = plane_on_grid(scan, ground)
    heights = readings.reshape(plane.shape)
    return ScannedTerrain(scan, np.where(heights > UNSEEN, heights + foot_radius, plane))


def plane_on_grid(scan: HeightScan, ground: TerrainPlane) -> Floats:
    """Return the heights of the plane `ground` at the points of `scan`, (n, rows, columns), m.

    Args:
        scan: Height scan.
        ground: Ground plane of n robots.

    Returns:
        Heights relative to the trunk centre.
    """
    grid = scan.grid
    return ground.at(*np.moveaxis(grid, -1, 0).reshape(2, -1)).reshape(-1, *grid.shape[:2])


def denoise_terrain(terrain: ScannedTerrain, ground: TerrainPlane, noise: Floats) -> tuple[ScannedTerrain, Floats]:
    """Shrink the scanned heights towards the ground plane, the more the larger their noise is.

    The result is the linear estimate with the least mean square error (Wiener filter, applied to each grid point).

    Args:
        terrain: Scanned terrain of n robots.
        ground: Plane through the footprints.
        noise: Noise variance of the scanned heights, (n,), m².

    Returns:
        terrain: Terrain with denoised heights.
        kept_fraction: Factor on the deviation of the heights from the plane, 0 to 1, (n,). It is 1 without noise.
    """
    plane = plane_on_grid(terrain.scan, ground)
    deviation = terrain.heights - plane
    variance = np.maximum((deviation * deviation).mean(axis=(1, 2)), _EDGE)
    kept_fraction = np.clip(1.0 - noise / variance, 0.0, 1.0)
    return terrain._replace(heights=plane + kept_fraction[:, None, None] * deviation), kept_fraction


class SwingProfile(NamedTuple):
    """Terrain heights under the swings of the four feet of n robots, level frame."""

    start: Floats
    """Terrain height at lift-off, (n, 4), m."""
    end: Floats
    """Terrain height at touch-down, (n, 4), m."""
    top: Floats
    """Largest terrain height between lift-off and touch-down, both included, (n, 4), m."""

    def over(self, _x: Floats, _y: Floats, progress: Floats) -> Floats:
        """Return a smooth height profile over the terrain: `start`, then `top` at mid-swing, then `end`.

        The method has the arguments of `policies.mpc.footing.Terrain`.

        Args:
            _x: Forward coordinate; not used.
            _y: Lateral coordinate; not used.
            progress: Progress of the swings, 0 to 1, (n, 4).

        Returns:
            Height, level frame, (n, 4), m.
        """
        arc = 4.0 * progress * (1.0 - progress)
        height: Floats = self.start + smoothstep(progress) * (self.end - self.start)
        return height + arc * arc * (self.top - 0.5 * (self.start + self.end))


class SightedMpcWbc(MpcWbc):
    """`MpcWbc` that reads the ground heights under the feet from a height scan.

    Swing feet land at the scanned height and clear the terrain on their way. Forces are planned for feet at different
    heights. The trunk is kept parallel to the scanned ground under the legs, at the reference height. The more noise
    the scan has, the more its heights are shrunk towards the plane through the footprints. If the scan is empty or only
    noise, the policy acts as `MpcWbc`.

    Args:
        parameters: Parameters of gait, estimators and cost; None for the parameters of the trot from `parameters_of`.
        robot: Robot that is controlled, or its name.
        control_period: Control period, s.
        joint_delay_steps: Delay of the encoders, control steps; 0 if the joint readings are the undelayed true values.
        actuator: Model of the joint motors.
        height_scan: Grid of the height scan in the observations.
    """

    name = "mpc_wbc_sighted"
    _level: Floats = per_robot(np.zeros(3), axis=1)
    """Low-pass filtered ground plane fitted to the scan, (3, n).

    Height under the trunk centre, m, slope forward and slope to the left, rise per metre."""

    def __init__(
        self,
        parameters: MpcParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
        joint_delay_steps: int = 0,
        actuator: Actuator = IDEAL,
        height_scan: HeightScan = SCAN,
    ) -> None:
        self.height_scan = height_scan
        self._scan = height_scan
        super().__init__(
            parameters,
            robot=robot,
            control_period=control_period,
            joint_delay_steps=joint_delay_steps,
            actuator=actuator,
        )
        self._scan_slice = table_with(self.robot, height_scan).slices["height_scan"]
        points = slice(0, height_scan.grid[..., 0].size)
        self._scan_noise = NoiseEstimator(control_period, [points], np.array([NOISE_FLOOR_STD]))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._heights = observation[:, self._scan_slice].astype(np.float64)
        return super()._act(observation)

    def _estimate_ground(self, state: MotionState, landed: Mask) -> TerrainPlane:
        """Update the terrain from the height scan, and return the ground plane.

        The plane is the filtered plane fitted to the scan, or the plane through the footprints if the scan is empty or
        only noise. `landed`: True for feet on the ground, (n, 4).
        """
        ground = super()._estimate_ground(state, landed)
        scanned = make_scanned_terrain(self._scan, self._heights, ground, self.robot.foot_radius)
        noise = self._scan_noise.update(scanned.heights.reshape(self.num_envs, -1))[:, 0]
        self._terrain, kept_fraction = denoise_terrain(scanned, ground, noise)
        is_empty = (self._heights <= UNSEEN).all(axis=1)
        self._scan_weight = np.where(is_empty, 0.0, kept_fraction)[:, None]
        """Weight of the scan relative to the plane through the footprints, 0 to 1, (n, 1).

        It is 0 if the scan is empty, and otherwise falls with the noise, see `denoise_terrain`."""
        plane = np.einsum("cij,nij->cn", plane_fit_weights(self._scan), self._terrain.heights)
        plane[1:] = np.clip(plane[1:], -MAX_SLOPE, MAX_SLOPE)
        gain = np.where(self._is_first_step, 1.0, lowpass_gain(self.control_period, PLANE_FILTER_TIME))
        self._level = self._level + gain * (plane - self._level)
        return TerrainPlane(*np.where(self._scan_weight[:, 0] > 0.0, self._level, ground))

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        """Return the function for the terrain height under the swings to the footholds, (n, 4, 2), m.

        It blends the scanned terrain with the terrain of `MpcWbc`, by the weight of the scan.
        """
        x, y, start = self.terrain_estimator.footprints.transpose(0, 2, 1)
        footprints = np.stack((x, y), axis=-1)
        end = self._terrain.at(foothold_positions)
        way = foothold_positions - footprints
        between = [self._terrain.at(footprints + fraction * way) for fraction in SWING_SAMPLES]
        scanned = SwingProfile(start, end, np.max([start, end, *between], axis=0)).over
        unscanned = super()._swing_terrain(foothold_positions, ground)
        return lambda x, y, t: self._scan_weight * scanned(x, y, t) + (1.0 - self._scan_weight) * unscanned(x, y, t)

    def _foothold_height(
        self, state: MotionState, foothold_positions: Floats, ground: TerrainPlane, stance_schedule: Mask
    ) -> Floats:
        """Return the ground height under each foot over the horizon, level frame, (n, N or 1, 4 or 1), m.

        It is the present height of a foot while the foot stays in stance, and the scanned height of its foothold
        afterwards. If the scan has no weight, it is the height of the ground plane.
        """
        stays_in_stance = np.cumprod(stance_schedule, axis=1).astype(np.bool_)
        scanned = self._terrain.at(foothold_positions)[:, None]
        height = np.where(stays_in_stance, state.bodies.feet[:, None, :, 2], scanned)
        unscanned = super()._foothold_height(state, foothold_positions, ground, stance_schedule)
        return np.where(self._scan_weight[..., None] > 0.0, height, unscanned)
