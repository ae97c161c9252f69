"""Physics engines (simulators), their supported features, and a check that an engine supports a scenario."""

from dataclasses import dataclass
from importlib.util import find_spec

from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.cli.extras import install_command
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, SmoothRandom

MUJOCO = "mujoco"
DRAKE = "drake"
WARP = "warp"
SIMULATORS = (MUJOCO, DRAKE)
"""Names of the physics engines for evaluation; WARP (MuJoCo Warp) is only for training, and so absent."""
RELATIVE_STEP_TIME = {MUJOCO: 1.0, DRAKE: 12.0}
"""Name of a physics engine -> time to compute a control step of one robot, as a multiple of MuJoCo's time."""


@dataclass(frozen=True)
class SimulatorFeatures:
    """Features of the environment that a physics engine supports; the defaults are the features of MuJoCo."""

    package: str | None = None
    """Python package of the physics engine; None for MuJoCo, which is always installed with this project."""
    summary: str = ""
    """Description of the supported features, for error messages."""
    robot_sensors: bool = True
    """True if the robot can have simulated sensors, for which the engine must compute outputs at the present state."""
    energy: bool = True
    """True if work, heat and foot impulses can be measured in every physics step."""
    hardware_profile: bool = True
    actuator_models: bool = True
    """True if actuators other than the ideal servo, and servos with a limited bandwidth, are supported."""
    weak_motors: bool = True
    """True if a scenario may reduce the torque limit of the motors, see `Motors`."""
    height_fields: bool = True
    soft_ground: bool = True
    per_env_models: bool = True
    """True if model fields may differ between robots, as domain randomisation requires."""
    per_env_servo_gains: bool = True
    nonlinear_joints: bool = True
    """True if joint springs and quadratic or cubic joint damping are supported."""
    outputs_of_all_steps: bool = True
    """True if one call can return the outputs of every physics step of a control step, see `RecordingBatch`."""
    implicit_damping: bool = True
    """True if MuJoCo's field `actuator_force` does not include the damping that is integrated implicitly.

    The field `qDeriv` then gives this damping. False if `actuator_force` is the whole torque that a joint received.
    """


SIMULATOR_FEATURES = {
    MUJOCO: SimulatorFeatures(),
    DRAKE: SimulatorFeatures(
        package="pydrake",
        summary="ideal motors, the true state, and level ground, slopes and stairs of any friction, with pushes, "
        "forces, payloads",
        robot_sensors=False,
        hardware_profile=False,
        actuator_models=False,
        weak_motors=False,
        height_fields=False,
        soft_ground=False,
        per_env_models=False,
        per_env_servo_gains=False,
        nonlinear_joints=False,
        outputs_of_all_steps=False,
        implicit_damping=False,
    ),
    WARP: SimulatorFeatures(
        package="mujoco_warp",
        summary="ideal motors and all else but height fields, slow motors and sensors of the robot",
        robot_sensors=False,
        energy=False,
        hardware_profile=False,
        actuator_models=False,
        height_fields=False,
        outputs_of_all_steps=False,
        implicit_damping=False,
    ),
}
"""Name of a physics engine -> features of the environment that it supports."""


def check_simulator(
    simulator: str,
    scenario: Scenario,
    actuator: Actuator,
    sensors: bool = False,
    readings: bool = False,
    per_env_servo_gains: bool = False,
) -> None:
    """Check that a physics engine supports a scenario, and the actuator, sensors and measurements.

    Args:
        simulator: Name of the physics engine.
        scenario: Scenario to simulate.
        actuator: Model of the joint servos.
        sensors: True if the robot has simulated sensors.
        readings: True if motors and contacts are measured in every physics step.
        per_env_servo_gains: True if the servo gains differ between the robots of a batch.

    Raises:
        ValueError: The physics engine is unknown, not installed, or does not support a requested feature; the message
            is one line.
    """
    if simulator not in SIMULATOR_FEATURES:
        raise ValueError(f"unknown simulator {simulator!r}; valid: {', '.join(SIMULATORS)}")
    features = SIMULATOR_FEATURES[simulator]
    if features.package is not None and find_spec(features.package) is None:
        raise ValueError(f"the simulator {simulator} needs its packages: {install_command(simulator)}")
    requested = _requested_features(scenario, actuator, sensors, readings, per_env_servo_gains)
    unsupported = [name for feature, name in requested if not getattr(features, feature)]
    if unsupported:
        raise ValueError(
            f"the simulator {simulator} does not support {' and '.join(unsupported)}; "
            f"it supports {features.summary}; use mujoco instead"
        )


def _requested_features(
    scenario: Scenario, actuator: Actuator, sensors: bool, readings: bool, per_env_servo_gains: bool
) -> list[tuple[str, str]]:
    """Return pairs for all requested features: field of `SimulatorFeatures`, and name for error messages.

    `sensors`, `readings` and `per_env_servo_gains` are True if `check_simulator` must check these features.
    """
    motors = f"the motors of {scenario.name!r}"
    candidates = (
        (sensors, "robot_sensors", "sensors of the robot"),
        (readings, "energy", "readings, which include energy"),
        (scenario.hardware, "hardware_profile", f"the hardware profile of {scenario.name!r}"),
        (scenario.motors.bandwidth is not None, "actuator_models", motors),
        (scenario.motors != Motors() and scenario.motors.bandwidth is None, "weak_motors", motors),
        (actuator != ACTUATORS["ideal"], "actuator_models", "motors other than ideal ones"),
        (
            isinstance(scenario.terrain, SmoothRandom | HeightField),
            "height_fields",
            f"the ground of {scenario.name!r}",
        ),
        (
            scenario.randomisation is not None,
            "per_env_models",
            f"the domain randomisation of {scenario.name!r}",
        ),
        (scenario.ground.sink_depth > 0, "soft_ground", f"the soft ground of {scenario.name!r}"),
        (per_env_servo_gains, "per_env_servo_gains", "servo gains that differ between robots"),
    )
    return [(feature, name) for is_requested, feature, name in candidates if is_requested]
