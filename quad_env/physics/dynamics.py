"""Rigid-body dynamics of a robot in any state, for controllers: inertia, bias forces, feet and their Jacobians.

Coordinates are those of MuJoCo's free joint: the generalised velocity is the trunk's linear velocity in the world
frame, m/s, its angular velocity in the base frame, rad/s, and the joint speeds, rad/s; (18). The world frame may be
any level one, such as that at the trunk's centre with x ahead.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quad_env.robots.robot import Robot

Floats = NDArray[np.float64]


class RigidBodies(NamedTuple):
    """Dynamics of n robots, each in its state."""

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


class Dynamics:
    """Works out the dynamics of robots without a payload, with ideal servos, on no ground."""

    def __init__(self, robot: Robot) -> None:
        import mujoco  # here, since it takes long, and whoever asks for a policy's name needs none

        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self._data = mujoco.MjData(self._model)
        self._trunk = self._model.body("base_link").id
        self._sites = [self._model.site(f"{leg}_foot").id for leg in robot.leg_names]
        self.mass = float(self._model.body_subtreemass[self._trunk])
        """Of the whole robot, kg."""

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
        mujoco, model, data, size = self._mujoco, self._model, self._data, self._model.nv
        data.qpos[:3], data.qpos[3:7], data.qpos[7:] = 0.0, orientation, angles
        data.qvel[:3], data.qvel[3:6], data.qvel[6:] = velocity, turning, speeds
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        inertia = np.empty((size, size))
        mujoco.mj_fullM(model, data, inertia)
        jacobians, changes = np.empty((len(self._sites), 3, size)), np.empty((3, size))
        drift = np.empty((len(self._sites), 3))
        feet = data.site_xpos[self._sites]
        for leg, site in enumerate(self._sites):
            mujoco.mj_jacSite(model, data, jacobians[leg], None, site)
            mujoco.mj_jacDot(model, data, changes, None, feet[leg], model.site_bodyid[site])
            drift[leg] = changes @ data.qvel
        centre_jacobian = np.empty((3, size))
        mujoco.mj_jacSubtreeCom(model, data, centre_jacobian, self._trunk)
        return (
            inertia,
            data.qfrc_bias - data.qfrc_passive,
            feet,
            jacobians,
            drift,
            data.subtree_com[self._trunk].copy(),
            centre_jacobian @ data.qvel,
            _symmetric(data.crb[self._trunk]),
        )


def _symmetric(composite: Floats) -> Floats:
    """The rotational inertia, (3, 3), of MuJoCo's record of a composite body."""
    xx, yy, zz, xy, xz, yz = composite[:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
