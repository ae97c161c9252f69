"""Rigid-body dynamics of a robot in any state, for controllers: inertia, bias forces, feet and their Jacobians.

Coordinates are those of MuJoCo's free joint: the generalised velocity is the trunk's linear velocity in the world
frame, m/s, its angular velocity in the base frame, rad/s, and the joint speeds, rad/s; (18). The world frame may be
any level one, such as that at the trunk's centre with x ahead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quad_env.robots.robot import Robot
from quad_env.robots.scene import build_spec

Floats = NDArray[np.float64]

_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Places of a matrix's entries in MuJoCo's xx, yy, zz, xy, xz, yz."""


class DynamicsTerms(NamedTuple):
    """Dynamics of n robots, each in its state."""

    mass: Floats
    """(n,), kg."""
    inertia: Floats
    """Joint-space inertia matrix, (n, 18, 18), armatures included."""
    bias_force: Floats
    """Generalised forces that hold the robot's acceleration at zero: Coriolis, centrifugal, gravity, joint damping;
    (n, 18)."""
    feet: Floats
    """Centres of the foot spheres, world frame, (n, 4, 3), m."""
    jacobians: Floats
    """Of the feet's velocities in the world frame, (n, 4, 3, 18)."""
    foot_bias_acceleration: Floats
    """Accelerations of the feet at zero generalised acceleration, world frame, (n, 4, 3), m/s²."""
    com_position: Floats
    """Centre of mass, world frame, (n, 3), m."""
    centre_velocity: Floats
    """Its velocity, world frame, (n, 3), m/s."""
    rotational_inertia: Floats
    """Of the robot as one rigid body, about the centre of mass, world frame, (n, 3, 3), kg·m²."""

    @property
    def leg_jacobians(self) -> Floats:
        """Of each foot by the joints of its own leg, world frame, (n, 4, 3, 3)."""
        by_leg = self.jacobians[..., 6:].reshape(*self.feet.shape, -1, 3)
        return np.ascontiguousarray(by_leg.diagonal(0, 1, 3).transpose(0, 3, 1, 2))


class _Model(NamedTuple):
    """What MuJoCo works with."""

    mujoco: Any
    """The package, which is imported where it is needed, since that takes long."""
    model: Any
    data: Any
    mass: float
    feet: list[tuple[int, int]]
    """Sites of the feet and the bodies that have them."""
    views: tuple[Any, ...]
    """Of `data`: positions and rates, which are written; sites, summed inertias, centre of mass and its velocity, bias
    and passive forces."""


def _prepared(mujoco: Any, model: Any, legs: Sequence[str]) -> _Model:
    """That model with its contacts off."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_SENSOR)
    data, trunk = mujoco.MjData(model), model.body("base_link").id
    sites = [model.site(f"{leg}_foot").id for leg in legs]
    sums, com_position, velocity = data.crb[trunk, :6], data.subtree_com[trunk], data.subtree_linvel[trunk]
    views = data.qpos, data.qvel, data.site_xpos, sums, com_position, velocity, data.qfrc_bias, data.qfrc_passive
    feet = list(zip(sites, model.site_bodyid[sites].tolist(), strict=True))
    return _Model(mujoco, model, data, float(np.round(model.body_subtreemass[trunk], 9)), feet, views)


@dataclass(frozen=True)
class Dynamics:
    """Works out the dynamics of a robot without a payload, with ideal servos, on no ground."""

    robot: Robot

    def __reduce__(self) -> tuple[type["Dynamics"], tuple[Robot]]:
        return Dynamics, (self.robot,)

    @cached_property
    def _compiled(self) -> _Model:
        import mujoco

        return _prepared(mujoco, build_spec(self.robot).compile(), self.robot.leg_names)

    def compute(
        self, orientation: Floats, velocity: Floats, angular_velocity: Floats, angles: Floats, speeds: Floats
    ) -> DynamicsTerms:
        """Dynamics with the trunk's centre in the origin.

        `orientation`: quaternions (w, x, y, z) from the base to the world frame, (n, 4); `velocity`: of the trunk's
        centre, world frame, (n, 3), m/s; `turning`: angular velocity, base frame, (n, 3), rad/s; `angles` and `speeds`
        of the joints, (n, 12), rad and rad/s.
        """
        count, size, legs = len(angles), 6 + angles.shape[1], len(self.robot.leg_names)
        shapes = (), (size, size), (size,), (legs, 3), (legs, 3, size), (legs, 3), (3,), (3,), (3, 3)
        found = DynamicsTerms(*(np.empty((count, *shape)) for shape in shapes))
        places = np.concatenate((np.zeros((count, 3)), orientation, angles), axis=1)
        rates = np.concatenate((velocity, angular_velocity, speeds), axis=1)
        changes = self._fill(found, places, rates).reshape(count, -1, size)
        found.foot_bias_acceleration[:] = np.matmul(changes, rates[..., None]).reshape(
            found.foot_bias_acceleration.shape
        )
        return found

    def _fill(self, found: DynamicsTerms, places: Floats, rates: Floats) -> Floats:
        """Work out all but the drift; changes of the feet's Jacobians a second, (n, 4, 3, 18)."""
        mujoco, model, data, found.mass[:], feet, views = self._compiled
        qpos, qvel, site_xpos, sums, com_position, centre_velocity, bias_force, passive = views
        changes = np.empty_like(found.jacobians)
        for i in range(len(places)):
            qpos[:], qvel[:] = places[i], rates[i]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_subtreeVel(model, data)
            mujoco.mj_fullM(model, data, found.inertia[i])
            np.subtract(bias_force, passive, out=found.bias_force[i])
            found.rotational_inertia[i] = sums[_SYMMETRIC]
            found.com_position[i], found.centre_velocity[i] = com_position, centre_velocity
            of_feet = zip(found.feet[i], found.jacobians[i], changes[i], feet, strict=True)
            for place, jacobian, change, (site, link) in of_feet:
                place[:] = site_xpos[site]
                mujoco.mj_jacSite(model, data, jacobian, None, site)
                mujoco.mj_jacDot(model, data, change, None, place, link)
        return changes
