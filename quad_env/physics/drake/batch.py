"""n robots that Drake steps, with the calls of MuJoCo's batch."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from quad_env.columns import Array, Rows
from quad_env.physics.drake.plant import inertia, plant_of

_TRUNK = 1
"""MuJoCo's id of the body with the free joint."""


class DrakeBatch:
    """See `quad_env.physics.batch.Batch`. Robots share a plant; each has a context of its own.

    Forces act on trunks alone. `actuator_force` is what the joint received: the servo's torque at the end of the step,
    within its limits, its damping included.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        self._model, self._data, self._drake = model, mujoco.MjData(model), plant_of(model)
        self._contexts = [self._drake.diagram.CreateDefaultContext() for _ in range(num_envs)]
        self._plants = [self._drake.plant.GetMyMutableContextFromRoot(each) for each in self._contexts]
        shapes = {
            "qpos": (model.nq,),
            "qvel": (model.nv,),
            "ctrl": (model.nu,),
            "actuator_force": (model.nu,),
            "xfrc_applied": (model.nbody, 6),
            "xpos": (model.nbody, 3),
            "site_xpos": (model.nsite, 3),
        }
        self._fields = {name: np.zeros((num_envs, *shape)) for name, shape in shapes.items()}
        self._own: dict[str, Array] = {}
        self._touches = np.zeros((num_envs, model.ngeom))
        """Contacts of each geom with the ground in the last physics step."""
        self._sensors: dict[str, tuple[list[int], Array]] = {}
        self.warning = np.zeros((num_envs, mujoco.mjtWarning.mjNWARNING.value, 2), np.int64)

    def bind(self, field: str) -> Array:
        """A field of the state or the outputs."""
        return self._fields[field]

    def expand(self, field: str) -> Array:
        """A field of the model, of each robot its own."""
        values = getattr(self._model, field)
        return self._own.setdefault(field, np.tile(values, (len(self._plants), *[1] * values.ndim)))

    def sensor(self, name: str) -> Any:
        """A sensor of contact with the ground; its `data` count contacts, (n, 1)."""
        number = self._model.sensor(name).id
        watched = int(self._model.sensor_objid[number])
        of_body = self._model.sensor_objtype[number] != mujoco.mjtObj.mjOBJ_GEOM
        geoms = np.flatnonzero(self._model.geom_bodyid == watched).tolist() if of_body else [watched]
        self._sensors.setdefault(name, (geoms, np.zeros((len(self._plants), 1))))
        return SimpleNamespace(data=self._sensors[name][1])

    def reset(self, ids: Rows, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest; nothing touches the ground yet."""
        for values in self._fields.values():
            values[ids] = 0.0
        for _, counts in self._sensors.values():
            counts[ids] = 0.0
        model = self._model
        self._fields["qpos"][ids] = model.qpos0 if keyframe is None else model.key_qpos[keyframe]
        if keyframe is not None:
            self._fields["ctrl"][ids] = model.key_ctrl[keyframe]

    def forward(self, ids: Rows, *, stage: int = 0) -> None:
        """Work out where the bodies and sites of those robots are."""
        for robot in ids:
            self._data.qpos[:] = self._fields["qpos"][robot]
            mujoco.mj_kinematics(self._model, self._data)
            self._fields["xpos"][robot], self._fields["site_xpos"][robot] = self._data.xpos, self._data.site_xpos

    def step(self, ids: Rows | None, nstep: int) -> None:
        """Move those robots, or all, on by some physics steps; one that Drake gives up on stands still, with a warning."""
        rows = range(len(self._plants)) if ids is None else ids
        for robot in rows:
            try:
                self._step(int(robot), nstep)
            except RuntimeError:
                self.warning[robot, int(mujoco.mjtWarning.mjWARN_BADQACC), 1] += 1
        for geoms, counts in self._sensors.values():
            counts[rows, 0] = self._touches[rows][:, geoms].sum(axis=1)

    def _step(self, robot: int, nstep: int) -> None:
        drake, context = self._drake, self._plants[robot]
        plant, fields = drake.plant, {name: values[robot] for name, values in self._fields.items()}
        plant.SetPositionsAndVelocities(context, self._to_drake(fields["qpos"], fields["qvel"]))
        desired = np.zeros(2 * plant.num_actuators())
        desired[drake.servos] = fields["ctrl"]
        plant.get_desired_state_input_port(drake.trunk.model_instance()).FixValue(context, desired)
        self._push(robot, context)
        for _ in range(nstep):
            coming = plant.EvalUniquePeriodicDiscreteUpdate(context)
            actuation = plant.get_net_actuation_output_port().Eval(context)
            contacts = plant.get_contact_results_output_port().Eval(context)
            context.SetDiscreteState(coming)
        fields["actuator_force"][:] = actuation[drake.servos]
        self._touches[robot] = self._with_ground(contacts)
        self._from_drake(plant.GetPositionsAndVelocities(context), fields["qpos"], fields["qvel"])

    def _push(self, robot: int, context: Any) -> None:
        force = ExternallyAppliedSpatialForce()
        force.body_index, force.p_BoBq_B = self._drake.trunk.index(), self._model.body_ipos[_TRUNK]
        pushing = self._fields["xfrc_applied"][robot, _TRUNK]
        force.F_Bq_W = SpatialForce(pushing[3:], pushing[:3])
        self._drake.plant.get_applied_spatial_force_input_port().FixValue(
            context, Value[list[ExternallyAppliedSpatialForce]]([force])
        )

    def _with_ground(self, contacts: Any) -> Array:
        """How often each geom touches the ground, (ngeom,)."""
        counts = np.zeros(self._model.ngeom)
        for number in range(contacts.num_point_pair_contacts()):
            pair = contacts.point_pair_contact_info(number).point_pair()
            both = [self._drake.geoms[each.get_value()] for each in (pair.id_A, pair.id_B)]
            if 0 in self._model.geom_bodyid[both]:
                counts[both] += 1.0
        return counts

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

    def set_const(self, ids: Rows) -> None:
        """Give those robots' trunks the inertia with their payloads, places of which are in the expanded `body_pos`."""
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_resetData(self._model, self._data)
            mujoco.mj_kinematics(self._model, self._data)
            carried = inertia(self._model, self._data, _TRUNK)
            self._drake.trunk.SetSpatialInertiaInBodyFrame(self._plants[robot], carried)

    def get_model(self, robot: int, model: mujoco.MjModel) -> None:
        """Write one robot's expanded fields there."""
        for field, values in self._own.items():
            getattr(model, field)[:] = values[robot]

    def get_data(self, robot: int) -> mujoco.MjData:
        """One robot's state; MuJoCo works out the rest of it."""
        data = mujoco.MjData(self._model)
        for field in ("qpos", "qvel", "ctrl", "xfrc_applied"):
            getattr(data, field)[:] = self._fields[field][robot]
        return data
