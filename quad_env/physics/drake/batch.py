"""n robots that Drake steps, with the calls of MuJoCo's batch."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.physics.array_batch import ArrayBatch
from quad_env.physics.drake.plant import inertia, plant_of
from quad_env.physics.simulators import DRAKE, SIMULATOR_FEATURES
from quad_env.robots.part_names import foot_geoms

_Forces = Value[list[ExternallyAppliedSpatialForce]]
_STEPPED = "qpos", "qvel", "ctrl", "actuator_force", "xfrc_applied"
_TRUNK = 1
"""MuJoCo's id of the body with the free joint."""


class DrakeBatch(ArrayBatch):
    """See `quad_env.physics.batch.Batch`. Robots share a plant; each has a context of its own.

    Forces act on trunks alone. `actuator_force` is what the joint received: the servo's torque at the end of the step,
    within its limits, its damping included.
    """

    features = SIMULATOR_FEATURES[DRAKE]
    """Features that this simulator supports."""

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        super().__init__(model, num_envs, (*_STEPPED, "xanchor", "site_xpos"))
        self._drake = plant_of(model)
        self._contexts = [self._drake.diagram.CreateDefaultContext() for _ in range(num_envs)]
        self._plants = list(map(self._drake.plant.GetMyMutableContextFromRoot, self._contexts))
        self._touches, self._forces = np.zeros((2, num_envs, model.ngeom))
        """Contacts of each geom with the ground in the last physics step, and the force of all that press it, N."""
        self._sensors: dict[str, tuple[Array, list[int], Array]] = {}
        """Of which of these, and of which geoms, each sensor's data are the sum."""
        self._known = [(b"", b"")] * num_envs
        """Positions and velocities of each context, as bytes."""

    def sensor(self, name: str) -> Any:
        """A sensor whose `data`, (n, 1), are a part's contacts with the ground, or the force that presses a foot, N."""
        model, number = self._model, self._model.sensor(name).id
        watched = int(model.sensor_objid[number])
        if model.sensor_type[number] == mujoco.mjtSensor.mjSENS_TOUCH:
            leg = name.partition("_foot_touch")[0]
            body = model.site_bodyid[watched]
            source = self._forces
            geoms = [geom for geom in foot_geoms(model, leg) if model.geom_bodyid[geom] == body]
        elif model.sensor_objtype[number] == mujoco.mjtObj.mjOBJ_GEOM:
            source, geoms = self._touches, [watched]
        else:
            source, geoms = self._touches, np.flatnonzero(model.geom_bodyid == watched).tolist()
        self._sensors.setdefault(name, (source, geoms, np.zeros((len(self._plants), 1))))
        return SimpleNamespace(data=self._sensors[name][2])

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest; nothing touches the ground yet."""
        super().reset(ids, keyframe, stage=stage)
        for _, _, data in self._sensors.values():
            data[ids] = 0.0

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Move those robots, or all, on by some physics steps; what Drake gives up on stands still, with a warning."""
        rows = np.arange(len(self._plants))[slice(None) if ids is None else ids]
        for robot in rows:
            try:
                self._step(int(robot), nstep)
            except (RuntimeError, SystemExit):  # the latter where its own checks fail, as of NaN
                self.warning[robot, int(mujoco.mjtWarning.mjWARN_BADQACC), 1] += 1
        for source, geoms, data in self._sensors.values():
            data[rows, 0] = source[rows][:, geoms].sum(axis=1)

    def _step(self, robot: int, nstep: int) -> None:
        plant, context = self._drake.plant, self._plants[robot]
        qpos, qvel, ctrl, torque, push = (self._fields[name][robot] for name in _STEPPED)
        self._set(robot, qpos, qvel, ctrl, push[_TRUNK])
        for _ in range(nstep):
            coming = plant.EvalUniquePeriodicDiscreteUpdate(context)
            actuation = plant.get_net_actuation_output_port().Eval(context)
            contacts = plant.get_contact_results_output_port().Eval(context)
            context.SetDiscreteState(coming)
        torque[:] = actuation[self._drake.servos]
        self._look_at(robot, contacts)
        self._from_drake(plant.GetPositionsAndVelocities(context), qpos, qvel)
        self._known[robot] = qpos.tobytes(), qvel.tobytes()

    def _set(self, robot: int, qpos: Array, qvel: Array, ctrl: Array, push: Array) -> None:
        """Targets, the force on the trunk, and a state that is not what the last step has left."""
        drake, context = self._drake, self._plants[robot]
        if self._known[robot] != (qpos.tobytes(), qvel.tobytes()):
            drake.plant.SetPositionsAndVelocities(context, self._to_drake(qpos, qvel))
        desired = np.zeros(2 * drake.plant.num_actuators())
        desired[drake.servos] = ctrl
        drake.plant.get_desired_state_input_port(drake.trunk.model_instance()).FixValue(context, desired)
        pushing = ExternallyAppliedSpatialForce()
        pushing.body_index, pushing.p_BoBq_B = drake.trunk.index(), self._model.body_ipos[_TRUNK]
        pushing.F_Bq_W = SpatialForce(push[3:], push[:3])
        drake.plant.get_applied_spatial_force_input_port().FixValue(context, _Forces([pushing]))

    def _look_at(self, robot: int, contacts: Any) -> None:
        """How often each geom touches the ground, and how hard it is pressed."""
        touches, forces = self._touches[robot], self._forces[robot]
        touches[:] = forces[:] = 0.0
        for number in range(contacts.num_point_pair_contacts()):
            contact = contacts.point_pair_contact_info(number)
            pair, force = contact.point_pair(), contact.contact_force()
            both = [self._drake.geoms[each.get_value()] for each in (pair.id_A, pair.id_B)]
            touches[both] += (self._model.geom_bodyid[both] == 0).any()
            forces[both] += abs(float(force.dot(pair.nhat_BA_W)))

    def _to_drake(self, qpos: Array, qvel: Array) -> Array:
        """Quaternion before place, angular velocity first and in the world frame."""
        state, hinges = np.empty(len(qpos) + len(qvel)), self._drake.hinges
        state[:4], state[4:7], state[7 + hinges] = qpos[3:7] / np.linalg.norm(qpos[3:7]), qpos[:3], qpos[7:]
        velocity = state[len(qpos) :]
        mujoco.mju_rotVecQuat(velocity[:3], qvel[3:6], state[:4])
        velocity[3:6], velocity[6 + hinges] = qvel[:3], qvel[6:]
        return state

    def _from_drake(self, state: Array, qpos: Array, qvel: Array) -> None:
        hinges, velocity = self._drake.hinges, state[len(qpos) :]
        qpos[3:7], qpos[:3], qpos[7:] = state[:4], state[4:7], state[7 + hinges]
        inverse = np.empty(4)
        mujoco.mju_negQuat(inverse, state[:4])
        mujoco.mju_rotVecQuat(qvel[3:6], velocity[:3], inverse)
        qvel[:3], qvel[6:] = velocity[3:6], velocity[6 + hinges]

    def set_const(self, ids: EnvIndices) -> None:
        """Give those robots' trunks the inertia with their payloads, places of which are in the expanded `body_pos`."""
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_resetData(self._model, self._data)
            mujoco.mj_kinematics(self._model, self._data)
            carried = inertia(self._model, self._data, _TRUNK)
            self._drake.trunk.SetSpatialInertiaInBodyFrame(self._plants[robot], carried)
