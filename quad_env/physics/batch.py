"""What the simulation needs of a simulator: the calls of MuJoCo's batch that it makes, which others answer too."""

from importlib.util import find_spec
from typing import Any, Protocol

from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.columns import Array, EnvIndices, EnvSelection
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, SmoothRandom

MUJOCO, DRAKE, WARP = "mujoco", "drake", "warp"
SIMULATORS = MUJOCO, DRAKE
"""Those that evaluate; WARP is for training alone."""
RELATIVE_STEP_TIME = {MUJOCO: 1.0, DRAKE: 12.0}
"""Time that each takes for a control step of a robot, times MuJoCo's."""
_PACKAGES = {DRAKE: "pydrake", WARP: "mujoco_warp"}
_SUPPORTED = {
    DRAKE: "ideal motors, the true state, and level ground, slopes and stairs of any friction, with pushes, forces, "
    "payloads",
    WARP: "ideal motors and all else but height fields, slow motors and sensors of the robot",
}

_BEYOND_DRAKE = "jnt_stiffness", "jnt_stiffnesspoly", "dof_dampingpoly"
"""Fields of a model that Drake's plant does not have."""


class Batch(Protocol):
    """n robots of one compiled model. Fields have MuJoCo's names, order, units and frames, a row a robot."""

    warning: Any
    """Warnings of each robot since its reset, (n, kinds of MuJoCo's warnings, 2): last, and how many."""

    def bind(self, field: str) -> Array:
        """A field of the state or the outputs, which follow every step; what is written there moves the robots."""

    def expand(self, field: str) -> Array:
        """A field of the model, of each robot its own from now on."""

    def sensor(self, name: str) -> Any:
        """A sensor, whose `data`, (n, size), are of the state before the last physics step."""

    def reset(self, ids: EnvIndices, keyframe: int | None = None, *, stage: int) -> None:
        """Put those robots at the model's start, or at a keyframe, at rest."""

    def forward(self, ids: EnvIndices, *, stage: int = ...) -> None:
        """Work out where the bodies and sites of those robots are."""

    def step(self, ids: EnvSelection | None, nstep: int) -> None:
        """Move those robots, or all, on by some physics steps. Raises mujoco.batch.SimulationError."""

    def set_const(self, ids: EnvIndices) -> None:
        """Work out what depends on the expanded fields of those robots."""

    def get_model(self, robot: int, model: Any) -> None:
        """Write one robot's model there."""

    def get_data(self, robot: int) -> Any:
        """A copy of one robot's simulation."""


def check_simulator(
    simulator: str, scenario: Scenario, actuator: Actuator, sensors: bool = False, readings: bool = False
) -> None:
    """ValueError, one line, unless the simulator of that name can do that; `sensors`: the robot has some of its own,
    `readings`: energy is measured."""
    if simulator not in (*SIMULATORS, WARP):
        raise ValueError(f"unknown simulator {simulator!r}; valid: {', '.join(SIMULATORS)}")
    if simulator == MUJOCO:
        return
    if find_spec(_PACKAGES[simulator]) is None:
        raise ValueError(f'the simulator {simulator} needs its packages: pip install -e ".[{simulator}]"')
    terrain, on_drake = scenario.terrain, simulator == DRAKE
    slow = scenario.motors.bandwidth is not None
    unsupported = {
        "sensors of the robot": sensors,
        "readings, for it measures no energy": simulator == WARP and readings,
        f"the hardware profile of {scenario.name!r}": scenario.hardware,
        f"the motors of {scenario.name!r}": slow or (on_drake and scenario.motors != Motors()),
        "motors other than ideal ones": actuator != ACTUATORS["ideal"],
        f"the ground of {scenario.name!r}": isinstance(terrain, SmoothRandom | HeightField),
        f"the domain randomisation of {scenario.name!r}": on_drake and scenario.randomisation is not None,
        f"the soft ground of {scenario.name!r}": on_drake and scenario.ground.sink_depth > 0,
    }
    if found := [what for what, asked in unsupported.items() if asked]:
        known = f"the simulator {simulator} knows {_SUPPORTED[simulator]}"
        raise ValueError(f"{known}; not {' and '.join(found)}: take mujoco for that")


def make_batch(simulator: str, model: Any, num_envs: int, nthread: int) -> Batch:
    """n robots of that compiled model in the simulator of that name."""
    if simulator == DRAKE:
        if any(getattr(model, field).any() for field in _BEYOND_DRAKE):
            raise ValueError(
                f"the simulator {simulator} knows linear damping of joints; not springs and not quadratic or cubic "
                "damping, which the model of the robot has: take mujoco for that"
            )
        from quad_env.physics.drake.batch import DrakeBatch  # an extra

        return DrakeBatch(model, num_envs)
    if simulator == WARP:
        from quad_env.physics.warp_batch import WarpBatch  # an extra

        return WarpBatch(model, num_envs)
    from mujoco.batch import Batch as MujocoBatch

    return MujocoBatch(model, num_envs, nthread)  # type: ignore[no-any-return]
