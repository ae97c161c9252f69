"""Rigid-body dynamics for controllers: inertia, bias forces, foot positions and Jacobians.

The coordinates are MuJoCo's coordinates of a free joint. The generalised velocity, (18), consists of the linear
velocity of the trunk, world frame, m/s, its angular velocity, base frame, rad/s, and the joint velocities, rad/s. The
world frame may be any frame with a vertical z axis, for example a frame at the trunk centre with a forward x axis.
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
"""Index of each component of a symmetric (3, 3) matrix in MuJoCo's order xx, yy, zz, xy, xz, yz."""


class DynamicsTerms(NamedTuple):
    """Terms of the equations of motion of n robots in given states; `Dynamics.compute` returns them."""

    mass: Floats
    """Total mass of each robot, (n,), kg."""
    inertia: Floats
    """Inertia matrix for the generalised velocity, with rotor inertias, (n, 18, 18), kg, kg·m and kg·m²."""
    bias_force: Floats
    """Bias force: generalised force at which the generalised acceleration is zero, (n, 18), N and N·m.

    The bias force balances Coriolis and centrifugal forces, gravity and joint damping.
    """
    feet: Floats
    """Centres of the foot spheres, world frame, (n, 4, 3), m."""
    jacobians: Floats
    """Jacobians that map the generalised velocity to the foot velocities, world frame, (n, 4, 3, 18)."""
    foot_bias_acceleration: Floats
    """Accelerations of the feet if the generalised acceleration is zero, world frame, (n, 4, 3), m/s²."""
    com_position: Floats
    """Position of the centre of mass, world frame, (n, 3), m."""
    com_velocity: Floats
    """Velocity of the centre of mass, world frame, (n, 3), m/s."""
    rotational_inertia: Floats
    """Rotational inertia about the centre of mass, with the joints locked, world frame, (n, 3, 3), kg·m²."""

    @property
    def leg_jacobians(self) -> Floats:
        """Jacobian of each foot for the three joint angles of its leg, world frame, (n, 4, 3, 3), m/rad."""
        by_leg = self.jacobians[..., 6:].reshape(*self.feet.shape, -1, 3)
        return np.ascontiguousarray(by_leg.diagonal(0, 1, 3).transpose(0, 3, 1, 2))


class _MujocoModel(NamedTuple):
    """MuJoCo's model and data, with views of the data fields that `Dynamics` writes and reads."""

    mujoco: Any
    """The package `mujoco`; it is imported on first use, because the import takes long."""
    model: Any
    data: Any
    mass: float
    feet: list[tuple[int, int]]
    """For each foot: MuJoCo's id of the site at its centre, and of the body with this site."""
    qpos: Any
    """Generalised positions in MuJoCo's order, (19,), which `Dynamics` writes before a computation."""
    qvel: Any
    """Generalised velocities in MuJoCo's order, (18,), which `Dynamics` writes before a computation."""
    site_positions: Any
    composite_inertia: Any
    """Rotational inertia of the robot with locked joints, in the order xx, yy, zz, xy, xz, yz, (6,), kg·m²."""
    com_position: Any
    com_velocity: Any
    bias_force: Any
    passive_force: Any


def _make_mujoco_model(mujoco: Any, model: Any, legs: Sequence[str]) -> _MujocoModel:
    """Disable constraints and sensors of `model`; return it with its data and views of the data fields.

    `mujoco` is the imported package, and `legs` are the names of the legs.
    """
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_SENSOR)
    data = mujoco.MjData(model)
    trunk = model.body("base_link").id
    sites = [model.site(f"{leg}_foot").id for leg in legs]
    return _MujocoModel(
        mujoco=mujoco,
        model=model,
        data=data,
        mass=float(np.round(model.body_subtreemass[trunk], 9)),
        feet=list(zip(sites, model.site_bodyid[sites].tolist(), strict=True)),
        qpos=data.qpos,
        qvel=data.qvel,
        site_positions=data.site_xpos,
        composite_inertia=data.crb[trunk, :6],
        com_position=data.subtree_com[trunk],
        com_velocity=data.subtree_linvel[trunk],
        bias_force=data.qfrc_bias,
        passive_force=data.qfrc_passive,
    )


@dataclass(frozen=True)
class Dynamics:
    """Rigid-body dynamics of a robot, computed by MuJoCo; payload and ground contact are not included."""

    robot: Robot
    """Robot for which the dynamics are computed."""

    def __reduce__(self) -> tuple[type["Dynamics"], tuple[Robot]]:
        return Dynamics, (self.robot,)

    @cached_property
    def _compiled(self) -> _MujocoModel:
        """Compiled MuJoCo model and data of the robot, which are created on first use."""
        import mujoco

        return _make_mujoco_model(mujoco, build_spec(self.robot, visuals=False).compile(), self.robot.leg_names)

    def compute(
        self, orientation: Floats, velocity: Floats, angular_velocity: Floats, angles: Floats, speeds: Floats
    ) -> DynamicsTerms:
        """Compute the terms of the equations of motion of n robots with the trunk centre at the origin.

        Args:
            orientation: Quaternions (w, x, y, z) from the base to the world frame, (n, 4).
            velocity: Velocity of the trunk centre, world frame, (n, 3), m/s.
            angular_velocity: Angular velocity of the trunk, base frame, (n, 3), rad/s.
            angles: Joint angles, (n, 12), rad.
            speeds: Joint velocities, (n, 12), rad/s.

        Returns:
            Inertia, bias forces, foot positions, Jacobians and centre of mass of the n robots.
        """
        terms = self._allocate(len(angles), angles.shape[1])
        qpos = np.concatenate((np.zeros((len(angles), 3)), orientation, angles), axis=1)
        qvel = np.concatenate((velocity, angular_velocity, speeds), axis=1)
        jacobian_rates = np.empty_like(terms.jacobians)
        for row in range(len(angles)):
            self._compute_row(terms, jacobian_rates[row], row, qpos[row], qvel[row])
        rates = jacobian_rates.reshape(len(angles), -1, qvel.shape[1])
        foot_bias_acceleration = np.matmul(rates, qvel[..., None])
        terms.foot_bias_acceleration[:] = foot_bias_acceleration.reshape(terms.foot_bias_acceleration.shape)
        return terms

    def _allocate(self, num_envs: int, num_joints: int) -> DynamicsTerms:
        """Return `DynamicsTerms` with uninitialised arrays for `num_envs` robots with `num_joints` joints."""
        size = 6 + num_joints
        legs = len(self.robot.leg_names)
        return DynamicsTerms(
            mass=np.empty(num_envs),
            inertia=np.empty((num_envs, size, size)),
            bias_force=np.empty((num_envs, size)),
            feet=np.empty((num_envs, legs, 3)),
            jacobians=np.empty((num_envs, legs, 3, size)),
            foot_bias_acceleration=np.empty((num_envs, legs, 3)),
            com_position=np.empty((num_envs, 3)),
            com_velocity=np.empty((num_envs, 3)),
            rotational_inertia=np.empty((num_envs, 3, 3)),
        )

    def _compute_row(self, terms: DynamicsTerms, jacobian_rates: Floats, row: int, qpos: Floats, qvel: Floats) -> None:
        """Compute the terms of one robot, and write them to the row `row` of `terms`.

        `qpos`, (19,), and `qvel`, (18,), are the robot's generalised position and velocity. The time derivatives of the
        foot Jacobians are written to `jacobian_rates`, (4, 3, 18). `foot_bias_acceleration` is not written, because
        `compute` derives it from these time derivatives.
        """
        compiled = self._compiled
        mujoco = compiled.mujoco
        model = compiled.model
        data = compiled.data
        compiled.qpos[:] = qpos
        compiled.qvel[:] = qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_subtreeVel(model, data)
        mujoco.mj_fullM(model, data, terms.inertia[row])
        terms.mass[row] = compiled.mass
        np.subtract(compiled.bias_force, compiled.passive_force, out=terms.bias_force[row])
        terms.rotational_inertia[row] = compiled.composite_inertia[_SYMMETRIC]
        terms.com_position[row] = compiled.com_position
        terms.com_velocity[row] = compiled.com_velocity
        foot_rows = zip(terms.feet[row], terms.jacobians[row], jacobian_rates, compiled.feet, strict=True)
        for position, jacobian, jacobian_rate, (site, body) in foot_rows:
            position[:] = compiled.site_positions[site]
            mujoco.mj_jacSite(model, data, jacobian, None, site)
            mujoco.mj_jacDot(model, data, jacobian_rate, None, position, body)
