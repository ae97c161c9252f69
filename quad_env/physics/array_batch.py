"""What batches of other simulators share: the state and the outputs of n robots in arrays, on MuJoCo's model."""

from collections.abc import Iterable

import mujoco
import numpy as np

from quad_env.columns import Array, EnvIndices


class ArrayBatch:
    """The calls of `quad_env.physics.batch.Batch` that need no simulator, on these fields of MuJoCo's data."""

    def __init__(self, model: mujoco.MjModel, num_envs: int, fields: Iterable[str]) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._fields = {name: np.zeros((num_envs, *getattr(self._data, name).shape)) for name in fields}
        self._own: dict[str, Array] = {}
        """Fields of the model that differ from robot to robot."""
        self.warning = np.zeros((num_envs, mujoco.mjtWarning.mjNWARNING.value, 2), np.int64)

    def bind(self, field: str) -> Array:
        """A field of the state or the outputs."""
        return self._fields[field]

    def expand(self, field: str) -> Array:
        """A field of the model, of each robot its own."""
        values = getattr(self._model, field)
        return self._own.setdefault(field, np.tile(values, (len(self.warning), *[1] * values.ndim)))

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest; nothing touches the ground yet."""
        for values in self._fields.values():
            values[ids] = 0.0
        mujoco.mj_resetDataKeyframe(self._model, self._data, -1 if keyframe is None else keyframe)
        self._fields["qpos"][ids], self._fields["ctrl"][ids] = self._data.qpos, self._data.ctrl

    def forward(self, ids: EnvIndices, *, stage: int = 0) -> None:
        """Work out where the bodies and sites of those robots are."""
        for robot in ids:
            self._data.qpos[:] = self._fields["qpos"][robot]
            mujoco.mj_kinematics(self._model, self._data)
            for field in ("xanchor", "site_xpos"):
                self._fields[field][robot] = getattr(self._data, field)

    def get_model(self, robot: int, model: mujoco.MjModel) -> None:
        """Write one robot's expanded fields there."""
        for field, values in self._own.items():
            getattr(model, field)[:] = values[robot]

    def get_data(self, robot: int) -> mujoco.MjData:
        """One robot's state; MuJoCo works out the rest of it."""
        data = mujoco.MjData(self._model)
        for field in self._fields.keys() & {"qpos", "qvel", "ctrl", "xfrc_applied", "act"}:
            getattr(data, field)[:] = self._fields[field][robot]
        return data
