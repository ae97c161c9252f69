"""Protocol of a batch of simulated robots: the methods of MuJoCo's batch that `Simulation` calls."""

from typing import Any, Protocol

from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.physics.simulators import DRAKE, SIMULATOR_FEATURES, WARP, SimulatorFeatures

_NONLINEAR_JOINT_FIELDS = ("jnt_stiffness", "jnt_stiffnesspoly", "dof_dampingpoly")
"""Model fields of joint springs and nonlinear joint damping."""


class Batch(Protocol):
    """Batch of n robots of one compiled model.

    Fields have one row per robot, with MuJoCo's names, order, units and frames.
    """

    warning: Any
    """MuJoCo's warnings of each robot since its reset: last value and count per kind, (n, kinds, 2)."""

    @property
    def features(self) -> SimulatorFeatures:
        """Features that the simulator of this batch supports."""

    def bind(self, field: str) -> Array:
        """Return the array that holds a state or output `field`; writing to a state field changes the robots."""

    def expand(self, field: str) -> Array:
        """Give every robot its own values of a model `field`, and return them, (n, ...)."""

    def sensor(self, name: str) -> Any:
        """Return the sensor called `name`; its attribute `data` holds the readings, (n, size).

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
        """Compute the outputs of the present state, such as positions of bodies and sites.

        Args:
            ids: Indices of the robots, (k,).
            stage: Last stage of MuJoCo's forward dynamics to compute, an `mjtStage`.
        """

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Advance robots by physics steps; MuJoCo's batch raises `mujoco.batch.SimulationError`.

        Args:
            ids: Robots to step; None for all.
            nstep: Number of physics steps.
        """

    def set_const(self, ids: EnvIndices) -> None:
        """Recompute the model constants of the robots `ids`, (k,), after a change of fields from `expand`."""

    def get_model(self, robot: int, model: Any) -> None:
        """Write the model fields that `expand` has made, for the robot with the index `robot`, into `model`."""

    def get_data(self, robot: int) -> Any:
        """Return a copy of the simulation data of the robot with the index `robot`."""


def make_batch(simulator: str, model: Any, num_envs: int, nthread: int) -> Batch:
    """Create a batch of robots in a simulator.

    Args:
        simulator: Name of the simulator.
        model: Compiled `mujoco.MjModel` of every robot.
        num_envs: Number of robots.
        nthread: Number of simulation threads; only MuJoCo uses it.

    Returns:
        The batch.

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
        from quad_env.physics.drake.batch import DrakeBatch  # here, because Drake is an optional dependency

        return DrakeBatch(model, num_envs)
    if simulator == WARP:
        from quad_env.physics.warp_batch import WarpBatch  # here, because MuJoCo Warp is an optional dependency

        return WarpBatch(model, num_envs)
    from quad_env.physics.mujoco_batch import MujocoBatch  # here, because MuJoCo takes long to import

    return MujocoBatch(model, num_envs, nthread)
