"""Base class of the batches of simulators other than MuJoCo: states and outputs of n robots in arrays."""

from collections.abc import Iterable

import mujoco
import numpy as np

from quad_env.columns import Array, EnvIndices

_STATE_FIELDS = {"qpos", "qvel", "ctrl", "xfrc_applied", "act"}
"""Fields of MuJoCo's data that define a state; MuJoCo computes all other fields from them."""


class ArrayBatch:
    """Implements the methods of `quad_env.physics.batch.Batch` that need no simulator.

    Args:
        model: Compiled model of every robot.
        num_envs: Number of robots.
        fields: Names of the fields of MuJoCo's data that the batch holds.

    Attributes:
        warning: MuJoCo's warnings of each robot since its reset: last value and count per kind, (n, kinds, 2).
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, fields: Iterable[str]) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._fields = {name: np.zeros((num_envs, *getattr(self._data, name).shape)) for name in fields}
        self._expanded: dict[str, Array] = {}
        """Name -> values, (n, ...), of the model fields that differ between robots."""
        self.warning = np.zeros((num_envs, mujoco.mjtWarning.mjNWARNING.value, 2), np.int64)

    def bind(self, field: str) -> Array:
        """Return the array that holds a state or output `field`; writing to a state field changes the robots."""
        return self._fields[field]

    def expand(self, field: str) -> Array:
        """Give every robot its own values of a model `field`, and return them, (n, ...)."""
        values = getattr(self._model, field)
        return self._expanded.setdefault(field, np.tile(values, (len(self.warning), *[1] * values.ndim)))

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put robots into the initial state of the model or of a keyframe, without computing contacts.

        Args:
            ids: Indices of the robots, (k,).
            keyframe: Index of the keyframe; None for the initial state of the model.
            stage: Not used.
        """
        for values in self._fields.values():
            values[ids] = 0.0
        mujoco.mj_resetDataKeyframe(self._model, self._data, -1 if keyframe is None else keyframe)
        self._fields["qpos"][ids] = self._data.qpos
        self._fields["ctrl"][ids] = self._data.ctrl

    def forward(self, ids: EnvIndices, *, stage: int = 0) -> None:
        """Compute the positions of joints and sites from the present state.

        Args:
            ids: Indices of the robots, (k,).
            stage: Not used.
        """
        for robot in ids:
            self._data.qpos[:] = self._fields["qpos"][robot]
            mujoco.mj_kinematics(self._model, self._data)
            for field in ("xanchor", "site_xpos"):
                self._fields[field][robot] = getattr(self._data, field)

    def get_model(self, robot: int, model: mujoco.MjModel) -> None:
        """Write the model fields that `expand` has made, for the robot with the index `robot`, into `model`."""
        for field, values in self._expanded.items():
            getattr(model, field)[:] = values[robot]

    def get_data(self, robot: int) -> mujoco.MjData:
        """Return new data with the state of the robot with the index `robot`; other fields are not computed."""
        data = mujoco.MjData(self._model)
        for field in self._fields.keys() & _STATE_FIELDS:
            getattr(data, field)[:] = self._fields[field][robot]
        return data
