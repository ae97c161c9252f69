"""Model-predictive control that sees the ground: footholds have the heights of a height scan."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions
from policies.gait_cycle import Floats, smoothstep
from policies.memory import lowpass_gain, per_robot
from policies.mpc.footing import MAX_SLOPE, Terrain, TerrainPlane
from policies.mpc.motion import MotionState
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from policies.mpc.reading_noise import NoiseEstimator
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import UNSEEN, HeightScan, table_with

SCAN = HeightScan(ahead=14, behind=14, aside=10, spacing=0.05)
"""The default scan."""
PLANE_FILTER_TIME = 0.1
"""Time constant with which the trunk takes that ground in, s."""
NOISE_FLOOR_STD = 0.02
"""Standard deviation, m, that a scan without noise seems to have where there are steps."""
_EDGE = 1e-9
SWING_SAMPLES = (0.25, 0.5, 0.75)
"""Where from foothold to foothold the ground is looked at that a foot is to clear."""
PLANE_FIT_HALF_SIZE = 0.45, 0.4
"""Half-length and half-width of the ground that the trunk is to be level with, m."""


class ScannedTerrain(NamedTuple):
    """Heights of feet that stand on a grid about n robots, level frame."""

    scan: HeightScan
    heights: Floats
    """(n, rows, columns), m."""

    def at(self, place: Floats) -> Floats:
        """Heights at places (n, 4, 2), m, (n, 4): linear between four points, beyond the grid that of its edge."""
        _, rows, columns = self.heights.shape
        u = np.clip(place[..., 0] / self.scan.spacing + self.scan.behind, 0.0, rows - 1.0)
        v = np.clip(place[..., 1] / self.scan.spacing + self.scan.aside, 0.0, columns - 1.0)
        row, column, robot = u.astype(np.intp), v.astype(np.intp), np.arange(len(place))[:, None]
        u, v = u - row, v - column
        after, beside = np.minimum(row + 1, rows - 1), np.minimum(column + 1, columns - 1)
        z = self.heights
        behind = (1.0 - v) * z[robot, row, column] + v * z[robot, row, beside]
        ahead = (1.0 - v) * z[robot, after, column] + v * z[robot, after, beside]
        height: Floats = (1.0 - u) * behind + u * ahead
        return height


@cache
def plane_fit_weights(scan: HeightScan) -> Floats:
    """What heights on the scan's grid are multiplied with to give the least-squares plane of those under the legs:
    height under the trunk's centre and rise per metre ahead and to the left, (3, rows, columns)."""
    x, y = np.moveaxis(scan.grid, -1, 0)
    length, width = PLANE_FIT_HALF_SIZE
    near = (np.abs(x) <= length + _EDGE) & (np.abs(y) <= width + _EDGE)
    shares = np.zeros((3, *x.shape))
    shares[:, near] = np.linalg.pinv(np.stack((np.ones(near.sum()), x[near], y[near]), axis=-1))
    return shares


def make_scanned_terrain(scan: HeightScan, shown: Floats, ground: TerrainPlane, foot_radius: float) -> ScannedTerrain:
    """The ground that the entries of a scan show, (n, p), m; by the footprints' plane where it is too deep to see."""
    plane = plane_on_grid(scan, ground)
    seen = shown.reshape(plane.shape)
    return ScannedTerrain(scan, np.where(seen > UNSEEN, seen + foot_radius, plane))


def plane_on_grid(scan: HeightScan, ground: TerrainPlane) -> Floats:
    """Heights of the plane at the scan's points, (n, rows, columns), m."""
    grid = scan.grid
    return ground.at(*np.moveaxis(grid, -1, 0).reshape(2, -1)).reshape(-1, *grid.shape[:2])


def denoise_terrain(seen: ScannedTerrain, ground: TerrainPlane, noise: Floats) -> tuple[ScannedTerrain, Floats]:
    """The ground as near to the plane as what is seen off it is noise of that variance, (n,), m²; and what share of
    its distance from the plane is kept, (n,).

    Every point by the linear estimate of least mean square error that knows nothing of the others.
    """
    plane = plane_on_grid(seen.scan, ground)
    apart = seen.heights - plane
    share = np.clip(1.0 - noise / np.maximum((apart * apart).mean(axis=(1, 2)), _EDGE), 0.0, 1.0)
    return seen._replace(heights=plane + share[:, None, None] * apart), share


class SwingProfile(NamedTuple):
    """What lies under four swings of n robots, (n, 4), m."""

    start: Floats
    end: Floats
    top: Floats
    """Highest ground on the way, footholds included."""

    def over(self, _x: Floats, _y: Floats, progress: Floats) -> Floats:
        """See `Terrain`: from foothold to foothold, halfway at the highest ground."""
        arc = 4.0 * progress * (1.0 - progress)
        height: Floats = self.start + smoothstep(progress) * (self.end - self.start)
        return height + arc * arc * (self.top - 0.5 * (self.start + self.end))


class SightedMpcWbc(MpcWbc):
    """`MpcWbc` whose footholds have the heights that a height scan shows.

    Swings end there and clear what lies on the way, forces are planned for feet at their own heights, and the trunk
    keeps level with the ground under the legs and at its height above that. Where the scan shows nothing the ground is
    the footprints' plane. Without its scan it walks as `MpcWbc`; the noisier the scan, the more it lifts its feet so.

    Args:
        parameters, robot, control_period, late, actuator: as of `MpcWbc`.
        height_scan: what it is shown: the environment's.
    """

    name = "mpc_wbc_sighted"
    _level: Floats = per_robot(np.zeros(3), axis=1)

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
        self.height_scan = self._scan = height_scan
        super().__init__(
            parameters,
            robot=robot,
            control_period=control_period,
            joint_delay_steps=joint_delay_steps,
            actuator=actuator,
        )
        self._shown = table_with(self.robot, height_scan).slices["height_scan"]
        points = slice(0, height_scan.grid[..., 0].size)
        self._scan_noise = NoiseEstimator(control_period, [points], np.array([NOISE_FLOOR_STD]))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._heights = observation[:, self._shown].astype(np.float64)
        return super()._act(observation)

    def _ground(self, now: MotionState, landed: Mask) -> TerrainPlane:
        ground = super()._ground(now, landed)
        seen = make_scanned_terrain(self._scan, self._heights, ground, self.robot.foot_radius)
        noise = self._scan_noise.update(seen.heights.reshape(self.num_envs, -1))[:, 0]
        self._seen_ground, kept = denoise_terrain(seen, ground, noise)
        self._scan_weight = np.where((self._heights <= UNSEEN).all(axis=1), 0.0, kept)[:, None]
        mean = np.einsum("cij,nij->cn", plane_fit_weights(self._scan), self._seen_ground.heights)
        mean[1:] = np.clip(mean[1:], -MAX_SLOPE, MAX_SLOPE)
        share = np.where(self._is_first_step, 1.0, lowpass_gain(self.control_period, PLANE_FILTER_TIME))
        self._level = self._level + share * (mean - self._level)
        return TerrainPlane(*np.where(self._scan_weight[:, 0] > 0.0, self._level, ground))

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        x, y, start = self.terrain_estimator.footprints.transpose(0, 2, 1)
        last, end = np.stack((x, y), axis=-1), self._seen_ground.at(foothold_positions)
        between = [self._seen_ground.at(last + share * (foothold_positions - last)) for share in SWING_SAMPLES]
        over, steps = (
            super()._swing_terrain(foothold_positions, ground),
            SwingProfile(start, end, np.max([start, end, *between], axis=0)).over,
        )
        return lambda x, y, t: self._scan_weight * steps(x, y, t) + (1.0 - self._scan_weight) * over(x, y, t)

    def _foothold_height(
        self, now: MotionState, foothold_positions: Floats, ground: TerrainPlane, stands: Mask
    ) -> Floats:
        lasting = np.cumprod(stands, axis=1).astype(np.bool_)
        seen = np.where(lasting, now.bodies.feet[:, None, :, 2], self._seen_ground.at(foothold_positions)[:, None])
        return np.where(
            self._scan_weight[..., None] > 0.0, seen, super()._foothold_height(now, foothold_positions, ground, stands)
        )
