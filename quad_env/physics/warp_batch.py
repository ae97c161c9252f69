"""Interface to MuJoCo Warp, which simulates n robots on a GPU, or on a CPU if there is no GPU.

Only training may use this interface; evaluation uses MuJoCo or Drake.
"""

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

_UPLOADED_FIELDS = ("qpos", "qvel", "ctrl", "xfrc_applied", "act")
_DOWNLOADED_FIELDS = ("qpos", "qvel", "act", "actuator_force", "xanchor", "site_xpos", "sensordata")
_DERIVED_FIELDS = ("body_subtreemass", "body_invweight0", "dof_invweight0")
"""Names of the model fields that MuJoCo's function `mj_setConst` computes from other model fields."""
_MAX_CONTACTS = 32
"""Maximum number of contacts of a robot; MuJoCo Warp ignores further contacts."""
_MAX_CONSTRAINT_ROWS = 160
"""Maximum number of constraint rows of a robot; MuJoCo Warp ignores further rows."""


class WarpBatch(ArrayBatch):
    """Batch of n robots in MuJoCo Warp; `quad_env.physics.batch.Batch` defines the interface.

    All robots are stepped at once, in single precision, with the Newton solver. The state is in host memory, in double
    precision, and a step copies the state to the device (GPU or CPU) and back. So the rest of the environment is the
    same as for MuJoCo.

    Args:
        model: Compiled model of every robot.
        num_envs: Number of robots.
    """

    features = SIMULATOR_FEATURES[WARP]
    """Features of the environment that MuJoCo Warp supports."""

    def __init__(self, model: mujoco.MjModel, num_envs: int) -> None:
        super().__init__(copy.copy(model), num_envs, dict.fromkeys((*_UPLOADED_FIELDS, *_DOWNLOADED_FIELDS)))
        self._model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        warp.config.log_level = warp.LOG_WARNING
        self._device_model = mujoco_warp.put_model(self._model)
        self._device_data = mujoco_warp.make_data(
            self._model, nworld=num_envs, nconmax=_MAX_CONTACTS, njmax=_MAX_CONSTRAINT_ROWS
        )
        self._is_model_stale = True
        """True if model fields that differ between robots have changed since the last copy to the device."""
        self._graphs: dict[int, Any] = {}
        """Number of physics steps -> compiled CUDA graph that advances all robots by this number."""

    def expand(self, field: str) -> Array:
        """Give every robot its own values of the MuJoCo model field `field`, and return them, (n, ...).

        Changed values take effect after the next call of `set_const`, or at the first step.
        """
        for name in _DERIVED_FIELDS:
            super().expand(name)
        return super().expand(field)

    def sensor(self, name: str) -> Any:
        """Return the MuJoCo sensor called `name`; its attribute `data` holds the readings, (n, size).

        The readings belong to the state before the last physics step.
        """
        sensor = self._model.sensor(name)
        start = int(sensor.adr[0])
        size = int(sensor.dim[0])
        return SimpleNamespace(data=self._fields["sensordata"][:, start : start + size])

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put robots into the initial state of the model or of a keyframe; contacts are not computed.

        Args:
            ids: Indices of the robots, (k,).
            keyframe: Index of the keyframe; None for the initial state of the model.
            stage: Not used, because this method computes no stage of the dynamics.
        """
        super().reset(ids, keyframe, stage=stage)
        mask = np.zeros(len(self.warning), np.bool_)
        mask[ids] = True
        mujoco_warp.reset_data(self._device_model, self._device_data, warp.array(mask))

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Advance robots by physics steps.

        Args:
            ids: Indices of the robots that get new states, or a slice; None for all robots.
            nstep: Number of physics steps.
        """
        if self._is_model_stale:
            self._upload_expanded_fields()
        # The steps are compiled before the state is uploaded, because the compilation steps the robots.
        run = self._compiled_steps(nstep)
        self._upload_state()
        run()
        self._download_state(slice(None) if ids is None else ids)

    def set_const(self, ids: EnvIndices) -> None:
        """Recompute the model constants of the robots `ids`, (k,), after a change of values from `expand`."""
        for robot in ids:
            self.get_model(int(robot), self._model)
            mujoco.mj_setConst(self._model, self._data)
            for name in _DERIVED_FIELDS:
                self._expanded[name][robot] = getattr(self._model, name)
        self._is_model_stale = True

    def _compiled_steps(self, steps: int) -> Callable[[], None]:
        """Return a function that advances all robots by `steps` physics steps.

        On a GPU the function launches a CUDA graph, because a graph saves the launch times of single kernels. Call this
        method before the state is copied to the device, because the compilation of a graph steps the robots.
        """
        if not warp.get_device().is_cuda:
            return partial(self._run, steps)
        if steps not in self._graphs:
            self._run(1)
            with warp.ScopedCapture() as capture:
                self._run(steps)
            self._graphs[steps] = capture.graph
        return partial(warp.capture_launch, self._graphs[steps])

    def _run(self, steps: int) -> None:
        """Advance all robots on the device by `steps` physics steps."""
        for _ in range(steps):
            mujoco_warp.step(self._device_model, self._device_data)

    def _upload_state(self) -> None:
        """Copy the state of all robots from host memory to the device, in single precision."""
        for name in _UPLOADED_FIELDS:
            values = self._fields[name]
            if values.size:
                rows = values.astype(np.float32).reshape(len(self.warning), -1)
                getattr(self._device_data, name).assign(rows)

    def _download_state(self, selection: EnvSelection) -> None:
        """Copy the state and outputs of the robots in `selection` from the device to host memory."""
        for name in _DOWNLOADED_FIELDS:
            values = self._fields[name]
            if values.size:
                device_values = getattr(self._device_data, name).numpy().reshape(values.shape)
                values[selection] = device_values[selection]

    def _upload_expanded_fields(self) -> None:
        """Copy the model fields that differ between robots to the device.

        Existing device arrays are overwritten and not replaced, because CUDA graphs read from the same memory.
        """
        for name, values in self._expanded.items():
            device_array = getattr(self._device_model, name)
            rows = values.astype(np.float32)
            if len(device_array) == len(values):
                device_array.assign(rows)
            else:
                setattr(self._device_model, name, warp.array(rows, dtype=device_array.dtype))
        self._is_model_stale = False
