"""Rigid-body dynamics of a robot in any state, for controllers: inertia, bias forces, feet and their Jacobians.

Coordinates are those of MuJoCo's free joint: the generalised velocity is the trunk's linear velocity in the world
frame, m/s, its angular velocity in the base frame, rad/s, and the joint speeds, rad/s; (18). The world frame may be
any level one, such as that at the trunk's centre with x ahead.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quad_env.robots.arena import spec_of
from quad_env.robots.robot import Robot

Floats = NDArray[np.float64]


class RigidBodies(NamedTuple):
    """Dynamics of n robots, each in its state."""

    mass: Floats
    """(n,), kg."""
    inertia: Floats
    """Joint-space inertia matrix, (n, 18, 18), armatures included."""
    bias: Floats
    """Generalised forces that hold the robot's acceleration at zero: Coriolis, centrifugal, gravity, joint damping;
    (n, 18)."""
    feet: Floats
    """Centres of the foot spheres, world frame, (n, 4, 3), m."""
    jacobians: Floats
    """Of the feet's velocities in the world frame, (n, 4, 3, 18)."""
    drift: Floats
    """Accelerations of the feet at zero generalised acceleration, world frame, (n, 4, 3), m/s²."""
    centre: Floats
    """Centre of mass, world frame, (n, 3), m."""
    centre_velocity: Floats
    """Its velocity, world frame, (n, 3), m/s."""
    rotational_inertia: Floats
    """Of the robot as one rigid body, about the centre of mass, world frame, (n, 3, 3), kg·m²."""

    @property
    def leg_jacobians(self) -> Floats:
        """Of each foot by the joints of its own leg, world frame, (n, 4, 3, 3)."""
        return np.stack([self.jacobians[:, i, :, 6 + 3 * i : 9 + 3 * i] for i in range(self.feet.shape[1])], axis=1)


class _Model(NamedTuple):
    """What MuJoCo works with."""

    mujoco: Any
    """The package, which is imported where it is needed, since that takes long."""
    model: Any
    data: Any
    trunk: int
    feet: list[int]


@dataclass(frozen=True)
class Dynamics:
    """Works out the dynamics of a robot without a payload, with ideal servos, on no ground."""

    robot: Robot

    def __reduce__(self) -> tuple[type["Dynamics"], tuple[Robot]]:
        return Dynamics, (self.robot,)

    @cached_property
    def _compiled(self) -> _Model:
        import mujoco

        model = spec_of(self.robot).compile()
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_SENSOR)
        feet = [model.site(f"{leg}_foot").id for leg in self.robot.leg_names]
        return _Model(mujoco, model, mujoco.MjData(model), model.body("base_link").id, feet)

    def at(self, orientation: Floats, velocity: Floats, turning: Floats, angles: Floats, speeds: Floats) -> RigidBodies:
        """Dynamics with the trunk's centre in the origin.

        `orientation`: quaternions (w, x, y, z) from the base to the world frame, (n, 4); `velocity`: of the trunk's
        centre, world frame, (n, 3), m/s; `turning`: angular velocity, base frame, (n, 3), rad/s; `angles` and `speeds`
        of the joints, (n, 12), rad and rad/s.
        """
        states = zip(orientation, velocity, turning, angles, speeds, strict=True)
        found = [self._of_one(*state) for state in states]
        return RigidBodies(*(np.stack(part) for part in zip(*found, strict=True)))

    def _of_one(self, orientation: Floats, velocity: Floats, turning: Floats, angles: Floats, speeds: Floats) -> Any:
        mujoco, model, data, trunk, sites = self._compiled
        size = model.nv
        data.qpos[:3], data.qpos[3:7], data.qpos[7:] = 0.0, orientation, angles
        data.qvel[:3], data.qvel[3:6], data.qvel[6:] = velocity, turning, speeds
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        inertia = np.empty((size, size))
        mujoco.mj_fullM(model, data, inertia)
        jacobians, changes = np.empty((len(sites), 3, size)), np.empty((3, size))
        drift = np.empty((len(sites), 3))
        feet = data.site_xpos[sites]
        for leg, site in enumerate(sites):
            mujoco.mj_jacSite(model, data, jacobians[leg], None, site)
            mujoco.mj_jacDot(model, data, changes, None, feet[leg], model.site_bodyid[site])
            drift[leg] = changes @ data.qvel
        centre_jacobian = np.empty((3, size))
        mujoco.mj_jacSubtreeCom(model, data, centre_jacobian, trunk)
        xx, yy, zz, xy, xz, yz = data.crb[trunk, :6]
        return (
            np.round(model.body_subtreemass[trunk], 9),
            inertia,
            data.qfrc_bias - data.qfrc_passive,
            feet,
            jacobians,
            drift,
            data.subtree_com[trunk].copy(),
            centre_jacobian @ data.qvel,
            np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        )
