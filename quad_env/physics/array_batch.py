"""Base class of the interfaces to Drake and MuJoCo Warp: states and outputs of n robots in arrays."""

from collections.abc import Iterable

import mujoco
import numpy as np

from quad_env.columns import Array, EnvIndices

_STATE_FIELDS = {"qpos", "qvel", "ctrl", "xfrc_applied", "act"}
"""Names of the fields of MuJoCo's data that define the state of a robot; all other fields follow from them."""


class ArrayBatch:
    """Base class of the interfaces to Drake and MuJoCo Warp: arrays of states and outputs of n robots.

    The class implements the methods of `quad_env.physics.batch.Batch` that do not need a physics engine.

    Args:
        model: Compiled model of every robot.
        num_envs: Number of robots.
        fields: Names of the fields of MuJoCo's data to hold, each as an array (n, ...).

    Attributes:
        warning: MuJoCo's warnings since the last reset of each robot, (n, kinds, 2). For each kind of warning, item 0
            is MuJoCo's number `lastinfo` about the last warning, and item 1 is the count of warnings.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, fields: Iterable[str]) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._fields = {name: np.zeros((num_envs, *getattr(self._data, name).shape)) for name in fields}
        self._expanded: dict[str, Array] = {}
        """Name of each model field that may differ between robots -> its values, (n, ...)."""
        self.warning = np.zeros((num_envs, mujoco.mjtWarning.mjNWARNING.value, 2), np.int64)

    def bind(self, field: str) -> Array:
        """Return the array, (n, ...), of the MuJoCo data field `field`, which every step updates in place.

        Writing to the array of a state field changes the robots.
        """
        return self._fields[field]

    def expand(self, field: str) -> Array:
        """Give every robot its own values of the MuJoCo model field `field`, and return them, (n, ...)."""
        values = getattr(self._model, field)
        return self._expanded.setdefault(field, np.tile(values, (len(self.warning), *[1] * values.ndim)))

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int = 0) -> None:
        """Put robots into the initial state of the model or of a keyframe; contacts are not computed.

        Args:
            ids: Indices of the robots, (k,).
            keyframe: Index of the keyframe; None for the initial state of the model.
            stage: Not used, because this method computes no stage of the dynamics.
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
            stage: Not used, because this method computes only the kinematics.
        """
        for robot in ids:
            self._data.qpos[:] = self._fields["qpos"][robot]
            mujoco.mj_kinematics(self._model, self._data)
            for field in ("xanchor", "site_xpos"):
                self._fields[field][robot] = getattr(self._data, field)

    def get_model(self, robot: int, model: mujoco.MjModel) -> None:
        """Write the values of the robot with index `robot` into all fields of `model` that robots do not share."""
        for field, values in self._expanded.items():
            getattr(model, field)[:] = values[robot]

    def get_data(self, robot: int) -> mujoco.MjData:
        """Return new MuJoCo data with the state of the robot with the index `robot`.

        Fields that MuJoCo derives from the state are not computed.
        """
        data = mujoco.MjData(self._model)
        for field in self._fields.keys() & _STATE_FIELDS:
            getattr(data, field)[:] = self._fields[field][robot]
        return data
