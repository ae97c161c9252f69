"""n robots that MuJoCo Warp steps, on a GPU where there is one, with the calls of MuJoCo's batch."""

import copy
from types import SimpleNamespace
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp

from quad_env.columns import Array, Ids, Rows

_GIVEN = "qpos", "qvel", "ctrl", "xfrc_applied", "act"
_FOUND = "qpos", "qvel", "act", "actuator_force", "xpos", "site_xpos", "sensordata"
_DERIVED = "body_subtreemass", "body_invweight0", "dof_invweight0"
"""Fields of the model that follow from others."""
_CONTACTS, _ROWS = 32, 160
"""Room for contacts of a robot, and for the rows of its constraints."""


class WarpBatch:
    """See `quad_env.physics.batch.Batch`. All robots are stepped together, in single precision, by Newton's method.

    The state lies here, in double precision; a step takes it to the device and back. So all else of an environment is
    the same code as for MuJoCo.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        self._model, self._data = copy.copy(model), mujoco.MjData(model)
        self._model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        warp.config.log_level = warp.LOG_WARNING
        self._warp = mujoco_warp.put_model(self._model)
        self._worlds = mujoco_warp.make_data(self._model, nworld=num_envs, nconmax=_CONTACTS, njmax=_ROWS)
        shapes = {name: getattr(self._data, name).shape for name in dict.fromkeys((*_GIVEN, *_FOUND))}
        self._fields = {name: np.zeros((num_envs, *shape)) for name, shape in shapes.items()}
        self._own: dict[str, Array] = {}
        self._changed = True
        """Whether the device does not know the fields of robots of their own yet."""
        self._graphs: dict[int, Any] = {}
        self.warning = np.zeros((num_envs, mujoco.mjtWarning.mjNWARNING.value, 2), np.int64)

    def bind(self, field: str) -> Array:
        """A field of the state or the outputs."""
        return self._fields[field]

    def expand(self, field: str) -> Array:
        """A field of the model, of each robot its own from the next `set_const`, or the first step, on."""
        for name in (field, *_DERIVED):
            values = getattr(self._model, name)
            self._own.setdefault(name, np.tile(values, (len(self.warning), *[1] * values.ndim)))
        return self._own[field]

    def sensor(self, name: str) -> Any:
        """A sensor, whose `data`, (n, size), are of the state before the last physics step."""
        start, size = int(self._model.sensor(name).adr[0]), int(self._model.sensor(name).dim[0])
        return SimpleNamespace(data=self._fields["sensordata"][:, start : start + size])

    def reset(self, ids: Rows, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest; nothing touches the ground yet."""
        for values in self._fields.values():
            values[ids] = 0.0
        mujoco.mj_resetDataKeyframe(self._model, self._data, -1 if keyframe is None else keyframe)
        self._fields["qpos"][ids], self._fields["ctrl"][ids] = self._data.qpos, self._data.ctrl
        mask = np.zeros(len(self.warning), np.bool_)
        mask[ids] = True
        mujoco_warp.reset_data(self._warp, self._worlds, warp.array(mask))

    def forward(self, ids: Rows, *, stage: int = 0) -> None:
        """Work out where the bodies and sites of those robots are."""
        for robot in ids:
            self._data.qpos[:] = self._fields["qpos"][robot]
            mujoco.mj_kinematics(self._model, self._data)
            self._fields["xpos"][robot], self._fields["site_xpos"][robot] = self._data.xpos, self._data.site_xpos

    def step(self, ids: Ids | None, nstep: int) -> None:
        """Move those robots, or all, on by some physics steps."""
        if self._changed:
            self._give_fields()
        for name in _GIVEN:
            if self._fields[name].size:
                getattr(self._worlds, name).assign(self._fields[name].astype(np.float32).reshape(len(self.warning), -1))
        self._run(nstep)
        rows = slice(None) if ids is None else ids
        for name in _FOUND:
            if (values := self._fields[name]).size:
                values[rows] = getattr(self._worlds, name).numpy().reshape(values.shape)[rows]

    def _run(self, steps: int) -> None:
        """Step all; on a GPU as one graph, without the time that each launch takes."""
        if not warp.get_device().is_cuda:
            for _ in range(steps):
                mujoco_warp.step(self._warp, self._worlds)
            return
        if steps not in self._graphs:
            mujoco_warp.step(self._warp, self._worlds)  # which compiles, and is undone by what is given next
            with warp.ScopedCapture() as capture:
                for _ in range(steps):
                    mujoco_warp.step(self._warp, self._worlds)
            self._graphs[steps] = capture.graph
        warp.capture_launch(self._graphs[steps])

    def _give_fields(self) -> None:
        """Take the fields that differ from robot to robot to the device, always to the same place there."""
        for name, values in self._own.items():
            there, single = getattr(self._warp, name), values.astype(np.float32)
            if len(there) == len(values):
                there.assign(single)
            else:
                setattr(self._warp, name, warp.array(single, dtype=there.dtype))
        self._changed = False

    def set_const(self, ids: Rows) -> None:
        """Work out what depends on the expanded fields of those robots."""
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_setConst(self._model, self._data)
            for name in _DERIVED:
                self._own[name][robot] = getattr(self._model, name)
        self._changed = True

    def get_model(self, robot: int, model: mujoco.MjModel) -> None:
        """Write one robot's expanded fields there."""
        for field, values in self._own.items():
            getattr(model, field)[:] = values[robot]

    def get_data(self, robot: int) -> mujoco.MjData:
        """One robot's state; MuJoCo works out the rest of it."""
        data = mujoco.MjData(self._model)
        for field in ("qpos", "qvel", "ctrl", "xfrc_applied", "act"):
            getattr(data, field)[:] = self._fields[field][robot]
        return data
