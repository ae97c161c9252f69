"""Simulators and the features of the environment that each simulator supports."""

from dataclasses import dataclass
from importlib.util import find_spec

from quad_env.actuation.models import ACTUATORS, Actuator
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField, SmoothRandom

MUJOCO = "mujoco"
DRAKE = "drake"
WARP = "warp"
SIMULATORS = (MUJOCO, DRAKE)
"""Simulators for evaluation; WARP is missing because it is for training only."""
RELATIVE_STEP_TIME = {MUJOCO: 1.0, DRAKE: 12.0}
"""Simulator -> computing time of a control step of one robot, as a multiple of MuJoCo's time."""


@dataclass(frozen=True)
class SimulatorFeatures:
    """Features of the environment that a simulator supports; the defaults are MuJoCo's."""

    package: str | None = None
    """Python package that must be installed for the simulator; None if the project always installs it."""
    summary: str = ""
    """Supported features in words, for error messages."""
    robot_sensors: bool = True
    """True if the robot can have simulated sensors, which read outputs of the present state."""
    energy: bool = True
    """True if work, heat and foot impulses can be measured in every physics step."""
    hardware_profile: bool = True
    actuator_models: bool = True
    """True if actuators other than the ideal servo, and motors with a bandwidth, are supported."""
    weak_motors: bool = True
    """True if the `Motors` of a scenario may differ from the defaults."""
    height_fields: bool = True
    soft_ground: bool = True
    per_env_models: bool = True
    """True if model fields may differ between robots, as domain randomisation requires."""
    per_env_servo_gains: bool = True
    nonlinear_joints: bool = True
    """True if joint springs and quadratic or cubic joint damping are supported."""
    implicit_damping: bool = True
    """True if the field `actuator_force` does not include the damping that the simulator integrates implicitly.

    The field `qDeriv` then gives this damping. False if `actuator_force` is the torque that the joint received.
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
        implicit_damping=False,
    ),
}
"""Name of each simulator -> features."""


def check_simulator(
    simulator: str,
    scenario: Scenario,
    actuator: Actuator,
    sensors: bool = False,
    readings: bool = False,
    per_env_servo_gains: bool = False,
) -> None:
    """Check that a simulator supports a scenario and the requested actuator, sensors and measurements.

    Args:
        simulator: Name of the simulator.
        scenario: Scenario to simulate.
        actuator: Actuator of the joints.
        sensors: True if the robot has simulated sensors.
        readings: True if motors and contacts are measured.
        per_env_servo_gains: True if servo gains differ between robots.

    Raises:
        ValueError: The simulator is unknown, not installed, or does not support a requested feature; one line.
    """
    if simulator not in SIMULATOR_FEATURES:
        raise ValueError(f"unknown simulator {simulator!r}; valid: {', '.join(SIMULATORS)}")
    features = SIMULATOR_FEATURES[simulator]
    if features.package is not None and find_spec(features.package) is None:
        raise ValueError(f'the simulator {simulator} needs its packages: pip install -e ".[{simulator}]"')
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
    """Return every requested feature: its field of `SimulatorFeatures`, and its name for error messages."""
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
