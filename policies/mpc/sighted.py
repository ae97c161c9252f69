"""Model-predictive controller that plans footholds and swing trajectories with the ground heights of a height scan."""

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
"""Default height scan: a grid of 29 x 21 points around the trunk, at a spacing of 0.05 m."""
PLANE_FILTER_TIME = 0.1
"""Time constant of the low-pass filter of the ground plane that is fitted to the height scan, s.

The trunk is kept parallel to this plane."""
NOISE_FLOOR_STD = 0.02
"""Noise floor: standard deviation that the noise estimator finds in a noise-free height scan of terrain with steps, m.

It is caused by the motion of the scan over the steps. Its square is subtracted from the estimated noise variance."""
SWING_SAMPLES = (0.25, 0.5, 0.75)
"""Points under a swing trajectory at which the terrain height is read from the height scan.

They are fractions of the straight line from the last footprint to the next foothold."""
PLANE_FIT_HALF_SIZE = (0.45, 0.4)
"""Half-length and half-width of the rectangle around the trunk in which a plane is fitted to the height scan, m."""
_EDGE = 1e-9
"""Tolerance for rounding errors of a grid position, m; also the smallest divisor in a ratio of variances, m²."""


class ScannedTerrain(NamedTuple):
    """Terrain heights on a grid around each of n robots, level frame (origin at the trunk centre, z up)."""

    scan: HeightScan
    """Height scan from which the heights were read; it defines the number and the spacing of the grid points."""
    heights: Floats
    """Height of the centre of a foot that stands on each grid point, level frame, (n, rows, columns), m.

    The level frame turns only with the yaw of the robot, and its z axis points up.

    The height is relative to the trunk centre. The row index increases forward, and the column index to the left."""

    def at(self, positions: Floats) -> Floats:
        """Return the terrain heights at four positions per robot, by bilinear interpolation on the grid.

        A position outside of the grid has the height of the nearest point on the edge of the grid.

        Args:
            positions: Positions (x, y), level frame (yaw only), (n, 4, 2), m.

        Returns:
            Heights relative to the trunk centre, (n, 4), m.
        """
        _, num_rows, num_columns = self.heights.shape
        row = _locate(positions[..., 0] / self.scan.spacing + self.scan.behind, num_rows)
        column = _locate(positions[..., 1] / self.scan.spacing + self.scan.aside, num_columns)
        height = self._in_row(row.lower, column)
        next_height = self._in_row(row.upper, column)
        interpolated: Floats = (1.0 - row.fraction) * height + row.fraction * next_height
        return interpolated

    def _in_row(self, row: EnvIndices, column: "GridCell") -> Floats:
        """Return the terrain heights at points on grid rows, (n, 4), m, by interpolation between two columns.

        `row`: index of the grid row for each foot, (n, 4); `column`: the two neighbouring columns of each foot and its
        position between them.
        """
        robot = np.arange(len(row))[:, None]
        height = self.heights[robot, row, column.lower]
        next_height = self.heights[robot, row, column.upper]
        interpolated: Floats = (1.0 - column.fraction) * height + column.fraction * next_height
        return interpolated


class GridCell(NamedTuple):
    """Position of each foot on one axis of a grid: the two neighbouring grid points, and the position between them."""

    lower: EnvIndices
    """Index of the grid point with the next smaller coordinate, for each foot of n robots, (n, 4)."""
    upper: EnvIndices
    """Index of the grid point with the next larger coordinate, for each foot of n robots, (n, 4).

    It equals `lower` at the end of the grid."""
    fraction: Floats
    """Position of each foot between the two neighbouring grid points, (n, 4): 0 at `lower`, 1 at `upper`."""


def _locate(coordinate: Floats, count: int) -> GridCell:
    """Return the two grid points next to each `coordinate`, (n, 4), on a grid axis with `count` points.

    The coordinates are counted in grid steps from the first point. They are clipped to the range of the axis.
    """
    clipped = np.clip(coordinate, 0.0, count - 1.0)
    index = clipped.astype(np.intp)
    return GridCell(index, np.minimum(index + 1, count - 1), clipped - index)


@cache
def plane_fit_weights(scan: HeightScan) -> Floats:
    """Return the weights of a least-squares fit of a plane to the heights on the grid of a height scan.

    A parameter of the plane is the sum of weight × height over the grid points. The weight is zero outside of the
    rectangle `PLANE_FIT_HALF_SIZE`.

    Args:
        scan: Height scan, which defines the grid.

    Returns:
        Weights for the three parameters of the plane, (3, rows, columns): height under the trunk centre, slope forward
        and slope to the left.
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
        scan: Height scan, which defines the grid.
        readings: Scanned heights of the ground at the p grid points, relative to the trunk centre, (n, p), m.
        ground: Plane through the last footprints of the feet. It gives the height at grid points for which the scan has
            no reading.
        foot_radius: Radius of a foot, m. It is added to the readings, because a `ScannedTerrain` has the heights of the
            centres of feet.

    Returns:
        Terrain of n robots.
    """
    plane = plane_on_grid(scan, ground)
    heights = readings.reshape(plane.shape)
    return ScannedTerrain(scan, np.where(heights > UNSEEN, heights + foot_radius, plane))


def plane_on_grid(scan: HeightScan, ground: TerrainPlane) -> Floats:
    """Return the heights of the ground plane at the grid points of a height scan.

    Args:
        scan: Height scan, which defines the grid.
        ground: Ground plane under each of n robots.

    Returns:
        Heights of the plane relative to the trunk centre, (n, rows, columns), m.
    """
    grid = scan.grid
    return ground.at(*np.moveaxis(grid, -1, 0).reshape(2, -1)).reshape(-1, *grid.shape[:2])


def denoise_terrain(terrain: ScannedTerrain, ground: TerrainPlane, noise: Floats) -> tuple[ScannedTerrain, Floats]:
    """Move the scanned heights towards the ground plane; the distance increases with the noise of the scan.

    The result is the linear estimate with the least mean square error (Wiener filter, applied to each grid point).

    Args:
        terrain: Scanned terrain of n robots.
        ground: Plane through the last footprints of the feet of each robot.
        noise: Noise variance of the scanned heights, (n,), m².

    Returns:
        terrain: Terrain with denoised heights.
        kept_fraction: Fraction of the heights' deviation from the plane that is kept, 0 to 1, (n,). It is 1 for a
            noise-free scan.
    """
    plane = plane_on_grid(terrain.scan, ground)
    deviation = terrain.heights - plane
    variance = np.maximum((deviation * deviation).mean(axis=(1, 2)), _EDGE)
    kept_fraction = np.clip(1.0 - noise / variance, 0.0, 1.0)
    return terrain._replace(heights=plane + kept_fraction[:, None, None] * deviation), kept_fraction


class SwingProfile(NamedTuple):
    """Terrain heights under the swing trajectories of the four feet of n robots, relative to the trunk centre."""

    start: Floats
    """Terrain height at the lift-off of each foot, relative to the trunk centre, (n, 4), m."""
    end: Floats
    """Terrain height at the touch-down of each foot, relative to the trunk centre, (n, 4), m."""
    top: Floats
    """Largest terrain height under the swing of each foot from lift-off to touch-down, (n, 4), m.

    It is relative to the trunk centre, like `start` and `end`."""

    def over(self, _x: Floats, _y: Floats, progress: Floats) -> Floats:
        """Return the height of a smooth curve over the terrain: `start`, then `top` at mid-swing, then `end`.

        The method has the arguments of the function type `policies.mpc.footing.Terrain`.

        Args:
            _x: Forward coordinate; not used.
            _y: Lateral coordinate; not used.
            progress: Elapsed fraction of the swing phase of each foot, 0 to 1, (n, 4).

        Returns:
            Height of the curve relative to the trunk centre, (n, 4), m.
        """
        arc = 4.0 * progress * (1.0 - progress)
        height: Floats = self.start + smoothstep(progress) * (self.end - self.start)
        return height + arc * arc * (self.top - 0.5 * (self.start + self.end))


class SightedMpcWbc(MpcWbc):
    """Policy `MpcWbc` with a height scan: it knows the height of the ground around the robot.

    Swing feet land at the scanned height and clear the terrain on their way. Contact forces are planned for feet at
    different heights. The trunk is kept parallel to the scanned ground under the legs, at the reference height. If the
    scan is noisy, its heights are moved towards the plane through the footprints, the last contact positions of the
    feet. If the scan is empty or contains only noise, the policy acts as `MpcWbc`.

    Args:
        parameters: Parameters of gait, estimators and cost; None for the parameters of the trot from `parameters_of`.
        robot: Robot that is controlled, or its name.
        control_period: Control period, s.
        joint_delay_steps: Delay of the joint encoders, control steps; 0 if the joint readings are the undelayed true
            values.
        actuator: Model of the joint motors.
        height_scan: Height scan in the observations, which defines the grid.
    """

    name = "mpc_wbc_sighted"
    _level: Floats = per_robot(np.zeros(3), axis=1)
    """Low-pass filtered parameters of the ground plane that is fitted to the height scan, (3, n).

    They are the height under the trunk centre, m, the slope forward and the slope to the left, rise per metre."""

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
        """Update the scanned terrain from the height scan, and return the ground plane under each robot.

        The result is the low-pass filtered plane that is fitted to the scan. If the scan is empty or contains only
        noise, the result is the plane through the last footprints. `landed`: True for feet on the ground, (n, 4).
        """
        ground = super()._estimate_ground(state, landed)
        scanned = make_scanned_terrain(self._scan, self._heights, ground, self.robot.foot_radius)
        noise = self._scan_noise.update(scanned.heights.reshape(self.num_envs, -1))[:, 0]
        self._terrain, kept_fraction = denoise_terrain(scanned, ground, noise)
        is_empty = (self._heights <= UNSEEN).all(axis=1)
        self._scan_weight = np.where(is_empty, 0.0, kept_fraction)[:, None]
        """Weight of the height scan relative to the plane through the footprints, 0 to 1, (n, 1).

        It is 0 if the scan is empty. Otherwise it decreases with the noise of the scan, see `denoise_terrain`."""
        plane = np.einsum("cij,nij->cn", plane_fit_weights(self._scan), self._terrain.heights)
        plane[1:] = np.clip(plane[1:], -MAX_SLOPE, MAX_SLOPE)
        gain = np.where(self._is_first_step, 1.0, lowpass_gain(self.control_period, PLANE_FILTER_TIME))
        self._level = self._level + gain * (plane - self._level)
        return TerrainPlane(*np.where(self._scan_weight[:, 0] > 0.0, self._level, ground))

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        """Return the function that gives the terrain height under the swing feet.

        It is the mean of the scanned terrain and the terrain of `MpcWbc`, weighted by the weight of the height scan.
        `foothold_positions`: next footholds (x, y), level frame (yaw only), (n, 4, 2), m; `ground`: ground plane.
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
        """Return the ground height under each foot in each of the N steps of the MPC horizon, (n, N, 4), m.

        The height is relative to the trunk centre. It is the present height of a foot while the foot stays in stance,
        and the scanned height of its foothold afterwards. If the weight of the scan is zero, it is the height of the
        ground plane. `stance_schedule`: True for stance feet in each step, (n, N, 4).
        """
        stays_in_stance = np.cumprod(stance_schedule, axis=1).astype(np.bool_)
        scanned = self._terrain.at(foothold_positions)[:, None]
        height = np.where(stays_in_stance, state.bodies.feet[:, None, :, 2], scanned)
        unscanned = super()._foothold_height(state, foothold_positions, ground, stance_schedule)
        return np.where(self._scan_weight[..., None] > 0.0, height, unscanned)
