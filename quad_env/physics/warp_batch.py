"""n robots that MuJoCo Warp steps, on a GPU where there is one, with the calls of MuJoCo's batch."""

import copy
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp

from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.physics.array_batch import ArrayBatch
from quad_env.physics.simulators import SIMULATOR_FEATURES, WARP

_UPLOADED_FIELDS = "qpos", "qvel", "ctrl", "xfrc_applied", "act"
_DOWNLOADED_FIELDS = "qpos", "qvel", "act", "actuator_force", "xanchor", "site_xpos", "sensordata"
_DERIVED = "body_subtreemass", "body_invweight0", "dof_invweight0"
"""Fields of the model that follow from others."""
_NCONMAX, _NJMAX = 32, 160
"""Room for contacts of a robot, and for the rows of its constraints."""


class WarpBatch(ArrayBatch):
    """See `quad_env.physics.batch.Batch`. All robots are stepped together, in single precision, by Newton's method.

    The state lies here, in double precision; a step takes it to the device and back. So all else of an environment is
    the same code as for MuJoCo.
    """

    features = SIMULATOR_FEATURES[WARP]
    """Features that this simulator supports."""

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        super().__init__(copy.copy(model), num_envs, dict.fromkeys((*_UPLOADED_FIELDS, *_DOWNLOADED_FIELDS)))
        self._model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        warp.config.log_level = warp.LOG_WARNING
        self._warp = mujoco_warp.put_model(self._model)
        self._worlds = mujoco_warp.make_data(self._model, nworld=num_envs, nconmax=_NCONMAX, njmax=_NJMAX)
        self._changed = True
        """Whether the device does not know the fields of robots of their own yet."""
        self._graphs: dict[int, Any] = {}

    def expand(self, field: str) -> Array:
        """A field of the model, of each robot its own from the next `set_const`, or the first step, on."""
        for name in _DERIVED:
            super().expand(name)
        return super().expand(field)

    def sensor(self, name: str) -> Any:
        """A sensor, whose `data`, (n, size), are of the state before the last physics step."""
        start, size = int(self._model.sensor(name).adr[0]), int(self._model.sensor(name).dim[0])
        return SimpleNamespace(data=self._fields["sensordata"][:, start : start + size])

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest; nothing touches the ground yet."""
        super().reset(ids, keyframe, stage=stage)
        mask = np.zeros(len(self.warning), np.bool_)
        mask[ids] = True
        mujoco_warp.reset_data(self._warp, self._worlds, warp.array(mask))

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Move those robots, or all, on by some physics steps."""
        if self._changed:
            self._give_fields()
        run = self._running(nstep)
        for name in _UPLOADED_FIELDS:
            if self._fields[name].size:
                getattr(self._worlds, name).assign(self._fields[name].astype(np.float32).reshape(len(self.warning), -1))
        run()
        rows = slice(None) if ids is None else ids
        for name in _DOWNLOADED_FIELDS:
            if (values := self._fields[name]).size:
                values[rows] = getattr(self._worlds, name).numpy().reshape(values.shape)[rows]

    def _running(self, steps: int) -> Callable[[], None]:
        """What makes so many steps of all; on a GPU one graph, which takes no time for each launch. To be asked for
        before the state is given: what compiles it moves the robots."""
        if not warp.get_device().is_cuda:
            return partial(self._run, steps)
        if steps not in self._graphs:
            self._run(1)
            with warp.ScopedCapture() as capture:
                self._run(steps)
            self._graphs[steps] = capture.graph
        return partial(warp.capture_launch, self._graphs[steps])

    def _run(self, steps: int) -> None:
        for _ in range(steps):
            mujoco_warp.step(self._warp, self._worlds)

    def _give_fields(self) -> None:
        """Take the fields that differ from robot to robot to the device, always to the same place there."""
        for name, values in self._own.items():
            there, single = getattr(self._warp, name), values.astype(np.float32)
            if len(there) == len(values):
                there.assign(single)
            else:
                setattr(self._warp, name, warp.array(single, dtype=there.dtype))
        self._changed = False

    def set_const(self, ids: EnvIndices) -> None:
        """Work out what depends on the expanded fields of those robots."""
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_setConst(self._model, self._data)
            for name in _DERIVED:
                self._own[name][robot] = getattr(self._model, name)
        self._changed = True
