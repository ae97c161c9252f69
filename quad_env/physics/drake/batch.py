"""Interface to Drake, which simulates n robots with the field names, units and frames of MuJoCo."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.physics.array_batch import ArrayBatch
from quad_env.physics.drake.plant import build_plant, spatial_inertia
from quad_env.physics.simulators import DRAKE, SIMULATOR_FEATURES
from quad_env.robots.part_names import foot_geoms

_Forces = Value[list[ExternallyAppliedSpatialForce]]
_STEPPED_FIELDS = ("qpos", "qvel", "ctrl", "actuator_force", "xfrc_applied")
"""Names of the fields of MuJoCo's data that a physics step in Drake reads or writes."""
_TRUNK = 1
"""MuJoCo's id of the body with the free joint."""


@dataclass(frozen=True)
class _ContactSensor:
    """Contact sensor of a robot part, which sums the ground contacts or normal forces of the part's geoms."""

    source: Array
    """Quantity to sum, for each robot and geom, (n, ngeom): number of ground contacts, or normal force, N."""
    geoms: list[int]
    """MuJoCo's ids of the geoms of the robot part."""
    data: Array
    """Reading of the sensor for each robot, (n, 1): number of ground contacts, or normal force, N."""


class DrakeBatch(ArrayBatch):
    """Batch of n robots in Drake; `quad_env.physics.batch.Batch` defines the interface.

    All robots share a Drake plant (model), and each robot has a Drake context, which holds its state. External forces
    act only on trunks. The field `actuator_force` is the torque that a joint received: the torque of the servo at the
    end of the step, including damping and the torque limit.

    Args:
        model: Compiled model of every robot.
        num_envs: Number of robots.
    """

    features = SIMULATOR_FEATURES[DRAKE]
    """Features of the environment that Drake supports."""

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        super().__init__(model, num_envs, (*_STEPPED_FIELDS, "xanchor", "site_xpos"))
        self._drake = build_plant(model)
        self._root_contexts = [self._drake.diagram.CreateDefaultContext() for _ in range(num_envs)]
        """Drake contexts of the whole diagram, which are stored to keep the contexts of the plant alive."""
        self._contexts = list(map(self._drake.plant.GetMyMutableContextFromRoot, self._root_contexts))
        self._contact_counts = np.zeros((num_envs, model.ngeom))
        """Number of ground contacts of each geom in the last physics step, (n, ngeom)."""
        self._contact_forces = np.zeros((num_envs, model.ngeom))
        """Sum of the normal forces on each geom in the last physics step, (n, ngeom), N."""
        self._sensors: dict[str, _ContactSensor] = {}
        self._context_states = [(b"", b"")] * num_envs
        """Pair of `qpos` and `qvel` of each robot after its last step, as bytes.

        The pair shows if the state was changed between two steps. Only then, Drake needs the new state.
        """

    def sensor(self, name: str) -> Any:
        """Return the contact sensor called `name`; its attribute `data` holds the readings, (n, 1).

        A reading is the number of ground contacts of a robot part, or the normal force on it, N.
        """
        if name not in self._sensors:
            source, geoms = self._contact_source(name)
            self._sensors[name] = _ContactSensor(source, geoms, np.zeros((len(self._contexts), 1)))
        return SimpleNamespace(data=self._sensors[name].data)

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put robots into the initial state of the model or of a keyframe; contacts are not computed.

        Args:
            ids: Indices of the robots, (k,).
            keyframe: Index of the keyframe; None for the initial state of the model.
            stage: Not used, because this method computes no stage of the dynamics.
        """
        super().reset(ids, keyframe, stage=stage)
        for sensor in self._sensors.values():
            sensor.data[ids] = 0.0

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Advance robots by physics steps; a robot that Drake cannot step gets a warning in `warning`.

        Args:
            ids: Indices of the robots to step, or a slice; None for all robots.
            nstep: Number of physics steps.
        """
        rows = np.arange(len(self._contexts))[slice(None) if ids is None else ids]
        for robot in rows:
            try:
                self._step(int(robot), nstep)
            except (RuntimeError, SystemExit):
                # Drake raises SystemExit if an assertion fails, for example because of NaN.
                self.warning[robot, int(mujoco.mjtWarning.mjWARN_BADQACC), 1] += 1
        for sensor in self._sensors.values():
            sensor.data[rows, 0] = sensor.source[rows][:, sensor.geoms].sum(axis=1)

    def set_const(self, ids: EnvIndices) -> None:
        """Recompute the trunk inertia of the robots `ids`, (k,), after a change of their payload positions.

        The payload positions are values of the model field `body_pos`.
        """
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_resetData(self._model, self._data)
            mujoco.mj_kinematics(self._model, self._data)
            inertia = spatial_inertia(self._model, self._data, _TRUNK)
            self._drake.trunk.SetSpatialInertiaInBodyFrame(self._contexts[robot], inertia)

    def _contact_source(self, name: str) -> tuple[Array, list[int]]:
        """Return the array that the contact sensor `name` sums, (n, ngeom), and MuJoCo's ids of its geoms.

        The array holds the number of ground contacts, or the normal force, N, of each geom.
        """
        model = self._model
        sensor_id = model.sensor(name).id
        object_id = int(model.sensor_objid[sensor_id])
        if model.sensor_type[sensor_id] == mujoco.mjtSensor.mjSENS_TOUCH:
            leg = name.partition("_foot_touch")[0]
            body = model.site_bodyid[object_id]
            geoms = [geom for geom in foot_geoms(model, leg) if model.geom_bodyid[geom] == body]
            return self._contact_forces, geoms
        if model.sensor_objtype[sensor_id] == mujoco.mjtObj.mjOBJ_GEOM:
            return self._contact_counts, [object_id]
        return self._contact_counts, np.flatnonzero(model.geom_bodyid == object_id).tolist()

    def _step(self, robot: int, nstep: int) -> None:
        """Advance the robot with the index `robot` by `nstep` physics steps."""
        plant = self._drake.plant
        context = self._contexts[robot]
        qpos, qvel, ctrl, torque, force = (self._fields[name][robot] for name in _STEPPED_FIELDS)
        self._set_context(robot, qpos, qvel, ctrl, force[_TRUNK])
        for _ in range(nstep):
            next_state = plant.EvalUniquePeriodicDiscreteUpdate(context)
            actuation = plant.get_net_actuation_output_port().Eval(context)
            contacts = plant.get_contact_results_output_port().Eval(context)
            context.SetDiscreteState(next_state)
        torque[:] = actuation[self._drake.servos]
        self._read_contacts(robot, contacts)
        self._from_drake(plant.GetPositionsAndVelocities(context), qpos, qvel)
        self._context_states[robot] = (qpos.tobytes(), qvel.tobytes())

    def _set_context(self, robot: int, qpos: Array, qvel: Array, ctrl: Array, force: Array) -> None:
        """Set joint targets `ctrl`, force on the trunk, and state in the Drake context of a robot.

        `force` is the force, N, and the torque, N·m, on the trunk, world frame, (6,). The state is set only if `qpos`
        or `qvel` has changed since the last step of the robot.
        """
        drake = self._drake
        context = self._contexts[robot]
        if self._context_states[robot] != (qpos.tobytes(), qvel.tobytes()):
            drake.plant.SetPositionsAndVelocities(context, self._to_drake(qpos, qvel))
        desired_state = np.zeros(2 * drake.plant.num_actuators())
        desired_state[drake.servos] = ctrl
        drake.plant.get_desired_state_input_port(drake.trunk.model_instance()).FixValue(context, desired_state)
        trunk_force = ExternallyAppliedSpatialForce()
        trunk_force.body_index = drake.trunk.index()
        trunk_force.p_BoBq_B = self._model.body_ipos[_TRUNK]
        trunk_force.F_Bq_W = SpatialForce(force[3:], force[:3])
        drake.plant.get_applied_spatial_force_input_port().FixValue(context, _Forces([trunk_force]))

    def _read_contacts(self, robot: int, contacts: Any) -> None:
        """Store the number of ground contacts and the sum of the normal forces of each geom of a robot.

        `contacts` are Drake's contact results of the last physics step.
        """
        counts = self._contact_counts[robot]
        forces = self._contact_forces[robot]
        counts[:] = 0.0
        forces[:] = 0.0
        for index in range(contacts.num_point_pair_contacts()):
            contact = contacts.point_pair_contact_info(index)
            pair = contact.point_pair()
            geoms = [self._drake.geoms[drake_id.get_value()] for drake_id in (pair.id_A, pair.id_B)]
            counts[geoms] += (self._model.geom_bodyid[geoms] == 0).any()
            forces[geoms] += abs(float(contact.contact_force().dot(pair.nhat_BA_W)))

    def _to_drake(self, qpos: Array, qvel: Array) -> Array:
        """Convert MuJoCo's positions `qpos`, (19,), and velocities `qvel`, (18,), to Drake's state, (37,).

        In Drake the quaternion precedes the position, and the angular velocity, world frame, precedes the linear
        velocity.
        """
        hinges = self._drake.hinges
        state = np.empty(len(qpos) + len(qvel))
        state[:4] = qpos[3:7] / np.linalg.norm(qpos[3:7])
        state[4:7] = qpos[:3]
        state[7 + hinges] = qpos[7:]
        velocity = state[len(qpos) :]
        mujoco.mju_rotVecQuat(velocity[:3], qvel[3:6], state[:4])
        velocity[3:6] = qvel[:3]
        velocity[6 + hinges] = qvel[6:]
        return state

    def _from_drake(self, state: Array, qpos: Array, qvel: Array) -> None:
        """Convert Drake's state, (37,), to MuJoCo's positions and velocities; write them to `qpos` and `qvel`."""
        hinges = self._drake.hinges
        velocity = state[len(qpos) :]
        qpos[3:7] = state[:4]
        qpos[:3] = state[4:7]
        qpos[7:] = state[7 + hinges]
        inverse = np.empty(4)
        mujoco.mju_negQuat(inverse, state[:4])
        mujoco.mju_rotVecQuat(qvel[3:6], velocity[:3], inverse)
        qvel[:3] = velocity[3:6]
        qvel[6:] = velocity[6 + hinges]
