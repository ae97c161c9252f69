"""Model-predictive control with a height scan, which gives the heights of footholds and swings."""

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
"""The default scan."""
PLANE_FILTER_TIME = 0.1
"""Time constant of the ground plane that the trunk is kept parallel to, s."""
NOISE_FLOOR_STD = 0.02
"""Standard deviation that the noise estimate shows for a scan of terrain with steps although its noise is zero, m."""
SWING_SAMPLES = (0.25, 0.5, 0.75)
"""Points of a swing at which the terrain is sampled, as fractions of the way from foothold to foothold."""
PLANE_FIT_HALF_SIZE = (0.45, 0.4)
"""Half-length and half-width of the area in which the plane is fitted, m."""
_EDGE = 1e-9
"""Tolerance for the rounding of a position, m, and smallest variance, m²."""


class ScannedTerrain(NamedTuple):
    """Terrain heights on a grid about n robots, level frame."""

    scan: HeightScan
    """Grid of the height scan."""
    heights: Floats
    """Height of the centre of a foot that stands on each grid point, (n, rows, columns), m."""

    def at(self, positions: Floats) -> Floats:
        """Return the heights at some positions by bilinear interpolation.

        Positions outside of the grid get the height of its edge.

        Args:
            positions: Positions, level frame, (n, 4, 2), m.

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
        """Return the heights in a `row` of the grid, (n, 4), m, by linear interpolation between two columns."""
        robot = np.arange(len(row))[:, None]
        height = self.heights[robot, row, column.lower]
        next_height = self.heights[robot, row, column.upper]
        interpolated: Floats = (1.0 - column.fraction) * height + column.fraction * next_height
        return interpolated


class GridCell(NamedTuple):
    """Two neighbouring grid points on one axis, with a foot between them, for n robots, (n, 4) each."""

    lower: EnvIndices
    """Index of the lower grid point."""
    upper: EnvIndices
    """Index of the upper grid point; equal to `lower` at the edge."""
    fraction: Floats
    """Position of the foot between both, 0 to 1."""


def _locate(coordinate: Floats, count: int) -> GridCell:
    """Return the cell of a coordinate, (n, 4), in grid steps, on an axis of `count` points."""
    clipped = np.clip(coordinate, 0.0, count - 1.0)
    index = clipped.astype(np.intp)
    return GridCell(index, np.minimum(index + 1, count - 1), clipped - index)


@cache
def plane_fit_weights(scan: HeightScan) -> Floats:
    """Return the weights with which the heights on a grid give the least-squares plane under the legs.

    Args:
        scan: Grid of the height scan.

    Returns:
        Weights for the height under the trunk centre, the rise per metre forward, and the rise per metre to the left,
        (3, rows, columns).
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
    """Make the terrain from the readings of a height scan.

    Args:
        scan: Grid of the height scan.
        readings: Heights of the ground, (n, p), m.
        ground: Plane through the footprints, which replaces points that are too deep to be seen.
        foot_radius: Radius of a foot, m.

    Returns:
        Terrain of n robots.
    """
    plane = plane_on_grid(scan, ground)
    heights = readings.reshape(plane.shape)
    return ScannedTerrain(scan, np.where(heights > UNSEEN, heights + foot_radius, plane))


def plane_on_grid(scan: HeightScan, ground: TerrainPlane) -> Floats:
    """Return the heights of the plane `ground` at the points of `scan`, (n, rows, columns), m."""
    grid = scan.grid
    return ground.at(*np.moveaxis(grid, -1, 0).reshape(2, -1)).reshape(-1, *grid.shape[:2])


def denoise_terrain(terrain: ScannedTerrain, ground: TerrainPlane, noise: Floats) -> tuple[ScannedTerrain, Floats]:
    """Shrink the scanned heights towards the plane by their noise.

    The estimate of each point is linear in the reading of this point and has the least mean square error (Wiener).

    Args:
        terrain: Scanned terrain of n robots.
        ground: Plane through the footprints.
        noise: Variance of the heights, (n,), m².

    Returns:
        terrain: Denoised terrain.
        kept_fraction: Fraction of the deviation from the plane that is kept, (n,).
    """
    plane = plane_on_grid(terrain.scan, ground)
    deviation = terrain.heights - plane
    variance = np.maximum((deviation * deviation).mean(axis=(1, 2)), _EDGE)
    kept_fraction = np.clip(1.0 - noise / variance, 0.0, 1.0)
    return terrain._replace(heights=plane + kept_fraction[:, None, None] * deviation), kept_fraction


class SwingProfile(NamedTuple):
    """Terrain under four swings of n robots, (n, 4) each, m."""

    start: Floats
    """Height at lift-off."""
    end: Floats
    """Height at touch-down."""
    top: Floats
    """Largest height on the way, both footholds included."""

    def over(self, _x: Floats, _y: Floats, progress: Floats) -> Floats:
        """Return the height of the terrain under the swings, largest halfway; the function is a `Terrain`.

        Args:
            _x: Not used.
            _y: Not used.
            progress: Progress of the swings, 0 to 1, (n, 4).

        Returns:
            Height, level frame, (n, 4), m.
        """
        arc = 4.0 * progress * (1.0 - progress)
        height: Floats = self.start + smoothstep(progress) * (self.end - self.start)
        return height + arc * arc * (self.top - 0.5 * (self.start + self.end))


class SightedMpcWbc(MpcWbc):
    """`MpcWbc` with footholds at the heights of a height scan.

    Swings end at the scanned height and clear the terrain on the way. Forces are planned for feet at different heights.
    The trunk is kept parallel to the ground under the legs, at the reference height. The plane through the footprints
    replaces the ground if the scan is empty. The weight of the scan falls as its noise grows; with weight 0 the policy
    acts as `MpcWbc`.

    Args:
        parameters: Gait, cost and gains; None for the parameters of `parameters_of`.
        robot: Robot that is controlled, or its name.
        control_period: Control period, s.
        joint_delay_steps: Delay of the encoders, control steps; 0 if the joint readings are true values.
        actuator: Drives of the joints.
        height_scan: Height scan of the environment.
    """

    name = "mpc_wbc_sighted"
    _level: Floats = per_robot(np.zeros(3), axis=1)
    """Filtered ground plane: height, m, and rise per metre forward and to the left, (3, n)."""

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
        """Return the filtered plane of the scan, or the plane through the footprints if the scan has weight 0."""
        ground = super()._estimate_ground(state, landed)
        scanned = make_scanned_terrain(self._scan, self._heights, ground, self.robot.foot_radius)
        noise = self._scan_noise.update(scanned.heights.reshape(self.num_envs, -1))[:, 0]
        self._terrain, kept_fraction = denoise_terrain(scanned, ground, noise)
        is_empty = (self._heights <= UNSEEN).all(axis=1)
        self._scan_weight = np.where(is_empty, 0.0, kept_fraction)[:, None]
        """Weight of the scan relative to the plane: 0 if the scan is empty, else the kept fraction, (n, 1)."""
        plane = np.einsum("cij,nij->cn", plane_fit_weights(self._scan), self._terrain.heights)
        plane[1:] = np.clip(plane[1:], -MAX_SLOPE, MAX_SLOPE)
        gain = np.where(self._is_first_step, 1.0, lowpass_gain(self.control_period, PLANE_FILTER_TIME))
        self._level = self._level + gain * (plane - self._level)
        return TerrainPlane(*np.where(self._scan_weight[:, 0] > 0.0, self._level, ground))

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        """Return the terrain under the swings, blended by the weight of the scan."""
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
        """Return the present height of feet that stay in stance, and scanned heights for the other feet."""
        stays_in_stance = np.cumprod(stance_schedule, axis=1).astype(np.bool_)
        scanned = self._terrain.at(foothold_positions)[:, None]
        height = np.where(stays_in_stance, state.bodies.feet[:, None, :, 2], scanned)
        unscanned = super()._foothold_height(state, foothold_positions, ground, stance_schedule)
        return np.where(self._scan_weight[..., None] > 0.0, height, unscanned)
