"""The feet of n robots, and what is remembered of their steps: since when each is in the air, and how fast it fell."""

from collections.abc import Callable, Sequence

import numpy as np

from quad_env.columns import Array, Column, Ids, Mask, Vector, of_robots
from quad_env.physics.state import Feet, rotation_matrix
from quad_env.robots.kinematics import feet_motion_in_world, foot_depths
from quad_env.robots.robot import Robot
from quad_env.scenarios.terrain import Terrain

BOUNCE = 1
"""Control steps in a row off the ground that are no swing, as in legged_gym's `contact_filt`: landing feet bounce."""
Columns = Callable[[Array], Vector[Column]]
"""Takes the columns of the wanted robots out of the rows of all."""


class Footsteps:
    """Looks at the feet of n robots after every control step of `period` seconds.

    Where feet are and how they move is worked out from the present `qpos` and `qvel`, rows of all robots; MuJoCo's own
    positions are those of the state before the last substep. `contacts`, of each foot what its sensors found, see
    `touching`, are those of that substep.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        period: float,
        qpos: Array,
        qvel: Array,
        contacts: Sequence[Sequence[Array]],
    ) -> None:
        self._robot, self._terrain, self._period = robot, terrain, period
        self._qpos, self._qvel, self._sensed = qpos, qvel, contacts
        n, legs = len(qpos), len(contacts)
        self._air = np.zeros((n, legs))
        """Control steps that each foot is off the ground; counted, so that no time is rounded more than once."""
        self._readings = np.zeros((n, 3 + 3 + 1 + 4, legs))
        """The fields of `Feet`, one after the other."""

    def begin(self, ids: Ids) -> None:
        """Begin the episode of those robots: no step of theirs is under way."""
        self._air[ids], self._readings[ids, 7:] = 0.0, 0.0
        self._look(ids)

    def advance(self, ids: Ids) -> None:
        """Take note of the control step that those robots have just made."""
        contact = touching(self._sensed, ids)
        air, falling = self._air[ids], np.maximum(-self._readings[ids, 5], 0.0)
        landed = contact & (air > BOUNCE)
        swing, impact = np.where(landed, self._period * air, 0.0), np.where(landed, falling, 0.0)
        self._air[ids] = air = np.where(contact, 0.0, air + 1.0)
        self._readings[ids, 7:] = np.stack((contact, self._period * air, swing, impact), axis=1)
        self._look(ids)

    def _look(self, ids: Ids) -> None:
        qpos, qvel = self._qpos[ids], self._qvel[ids]
        with np.errstate(all="ignore"):  # of a robot that has diverged, which is about to be parked
            rotation = np.moveaxis(np.array(rotation_matrix(of_robots(qpos[:, 3:7]))), -1, 0)
            position, velocity = feet_motion_in_world(self._robot, rotation, qpos, qvel)
            x, y = np.nan_to_num(position[..., :2]).transpose(2, 0, 1)
            height = position[..., 2] - self._terrain.height(x, y) - foot_depths(self._robot, rotation, qpos[:, 7:])
        self._readings[ids, :3], self._readings[ids, 3:6] = position.transpose(0, 2, 1), velocity.transpose(0, 2, 1)
        self._readings[ids, 6] = height

    def feet(self, columns: Columns[Column]) -> Feet[Column]:
        """Readings now."""
        n, _, legs = self._readings.shape
        flat = columns(self._readings.reshape(n, -1))
        xyz, scalars = flat[: 6 * legs], [tuple(flat[k * legs : (k + 1) * legs]) for k in range(6, 11)]
        height, contact, air_time, swing_time, impact_speed = scalars
        return Feet(
            position=tuple(xyz[leg : 3 * legs : legs] for leg in range(legs)),
            velocity=tuple(xyz[3 * legs + leg :: legs] for leg in range(legs)),
            height=height,
            contact=tuple(touching > 0 for touching in contact),
            air_time=air_time,
            swing_time=swing_time,
            impact_speed=impact_speed,
        )


def touching(contacts: Sequence[Sequence[Array]], ids: Ids) -> Mask:
    """Which parts of those robots touched the ground, (k, parts); `contacts` are what each part's sensors counted,
    (n, 1) each."""
    counts = [sum((found[ids] for found in others), first[ids]) for first, *others in contacts]
    return np.concatenate(counts, axis=1) > 0
