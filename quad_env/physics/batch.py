"""Interface that each physics engine implements, and a function that creates the interface to an engine."""

from collections.abc import Sequence
from typing import Any, Protocol

from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.physics.simulators import DRAKE, SIMULATOR_FEATURES, WARP, SimulatorFeatures

_NONLINEAR_JOINT_FIELDS = ("jnt_stiffness", "jnt_stiffnesspoly", "dof_dampingpoly")
"""Names of the MuJoCo model fields of joint springs and nonlinear joint damping."""


class Batch(Protocol):
    """Interface to a physics engine that simulates n robots of one compiled model.

    The methods have the names, arguments and results of the methods of MuJoCo's class `mujoco.batch.Batch`.

    The arrays have one row per robot, with the names, order, units and frames of MuJoCo's fields.
    """

    warning: Any
    """MuJoCo's warnings since the last reset of each robot, (n, kinds, 2).

    For each kind of warning, item 0 is MuJoCo's number `lastinfo` about the last warning, and item 1 is the count of
    warnings.
    """

    @property
    def features(self) -> SimulatorFeatures:
        """Features of the environment that the physics engine supports."""

    def bind(self, field: str) -> Array:
        """Return the array, (n, ...), of the MuJoCo data field `field`, which every step updates in place.

        Writing to the array of a state field changes the robots.
        """

    def expand(self, field: str) -> Array:
        """Give every robot its own values of the MuJoCo model field `field`, and return them, (n, ...)."""

    def sensor(self, name: str) -> Any:
        """Return the MuJoCo sensor called `name`; its attribute `data` holds the readings, (n, size).

        The readings belong to the state before the last physics step.
        """

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int) -> None:
        """Put robots into the initial state of the model or of a keyframe.

        Args:
            ids: Indices of the robots, (k,).
            keyframe: Index of the keyframe; None for the initial state of the model.
            stage: Last stage of MuJoCo's forward dynamics to compute, an `mjtStage`.
        """

    def forward(self, ids: EnvIndices, *, stage: int = ...) -> None:
        """Compute the output fields at the present state, such as positions of bodies and sites.

        Args:
            ids: Indices of the robots, (k,).
            stage: Last stage of MuJoCo's forward dynamics to compute, an `mjtStage`.
        """

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Advance robots by physics steps; MuJoCo raises `mujoco.batch.SimulationError` if robots fail.

        Args:
            ids: Indices of the robots to step, or a slice; None for all robots.
            nstep: Number of physics steps.
        """

    def set_const(self, ids: EnvIndices) -> None:
        """Recompute the model constants of the robots `ids`, (k,), after a change of arrays from `expand`.

        MuJoCo computes these constants, such as inverse weights, from other model fields.
        """

    def get_model(self, robot: int, model: Any) -> None:
        """Write the values of the robot with index `robot` into all fields of `model` that robots do not share."""

    def get_data(self, robot: int) -> Any:
        """Return a copy of the MuJoCo data of the robot with the index `robot`."""


class RecordingBatch(Batch, Protocol):
    """Interface to a physics engine with the feature `outputs_of_all_steps`; only MuJoCo has it."""

    state: Array
    """Complete state of each robot, (n, size); writing to it changes the robots."""

    def rollout(
        self,
        nstep: int,
        control: Array | None,
        *,
        record: Sequence[str],
        ids: EnvSelection | None,
        out: dict[str, Array] | None,
    ) -> dict[str, Array]:
        """Advance robots by physics steps, and return output fields after each step.

        A robot with a new warning is not stepped further.

        Args:
            nstep: Number of physics steps.
            control: Joint targets in each physics step, (k, nstep, 12), rad; None to keep the present ones.
            record: Names of the fields.
            ids: Indices of k robots; None for all robots.
            out: Result of an earlier call for the same number of robots, to which the values are written.

        Returns:
            Name of a field -> values after each step, (k, nstep, size).
        """


def make_batch(simulator: str, model: Any, num_envs: int, nthread: int) -> Batch:
    """Create the interface to a physics engine that simulates `num_envs` robots.

    Args:
        simulator: Name of the physics engine: `mujoco`, `drake` or `warp`.
        model: Compiled `mujoco.MjModel` of every robot.
        num_envs: Number of robots.
        nthread: Number of simulation threads; only MuJoCo uses this number.

    Returns:
        Interface to the physics engine.

    Raises:
        ValueError: The model has joint springs or nonlinear joint damping, which the simulator does not support.
    """
    has_nonlinear_joints = any(getattr(model, field).any() for field in _NONLINEAR_JOINT_FIELDS)
    if has_nonlinear_joints and not SIMULATOR_FEATURES[simulator].nonlinear_joints:
        raise ValueError(
            f"the simulator {simulator} does not support joint springs or quadratic or cubic joint damping, which the "
            "model of the robot has; it supports linear damping; use mujoco instead"
        )
    if simulator == DRAKE:
        # The module is imported here, because Drake is an optional dependency.
        from quad_env.physics.drake.batch import DrakeBatch

        return DrakeBatch(model, num_envs)
    if simulator == WARP:
        # The module is imported here, because MuJoCo Warp is an optional dependency.
        from quad_env.physics.warp_batch import WarpBatch

        return WarpBatch(model, num_envs)
    # The module is imported here, because the import of MuJoCo takes long.
    from quad_env.physics.mujoco_batch import MujocoBatch

    return MujocoBatch(model, num_envs, nthread)
