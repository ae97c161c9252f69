"""Hardware of the robots of a run: robot, servos, motors, sensors, estimator and simulator, by name.

It imports other packages only when they are used, so that --help stays quick.
"""

import sys
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from quad_env.cli.command_line import UsageError

if TYPE_CHECKING:
    from policies.base import Policy
    from quad_env.robots.robot import Robot
    from quad_env.scenarios.scenario import Scenario


@dataclass(frozen=True)
class HardwareConfig:
    """Names of the hardware, with the meaning of the environment's keyword arguments of the same names."""

    actuator: str = "ideal"
    sensors: str = "truth"
    estimator: str = "complementary"
    robot: str = "simple_quad"
    """Name of the robot, or path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos for our controllers, N·m/rad and N·m·s/rad; empty for each policy's own."""
    simulator: str = "mujoco"
    """Simulator of the physics, one of `quad_env.physics.simulators.SIMULATORS`."""

    @property
    def robot_model(self) -> "Robot":
        """Robot with the servo gains of `servo`; errors as for `quad_env.robots.registry.get_robot`."""
        from quad_env.robots.registry import get_robot

        robot = get_robot(self.robot)
        if not self.servo:
            return robot
        try:
            stiffness, damping = map(float, self.servo.split("/"))
            return robot.with_servo(stiffness, damping)
        except ValueError:
            raise ValueError(f"servo is stiffness/damping above 0, such as 35/0.5, not {self.servo!r}") from None

    def env_kwargs(self, robot: "Robot") -> dict[str, Any]:
        """Return the keyword arguments of an environment with the servo gains of a policy's `robot`."""
        robot_model = self.robot_model.with_servo(robot.servo_stiffness, robot.servo_damping)
        names = ("actuator", "sensors", "estimator", "simulator")
        return {name: getattr(self, name) for name in names} | {"robot": robot_model}

    def policy(
        self, name_or_path: str, trust: bool = False, *, on_hardware_profile: bool = False, **options: Any
    ) -> "Policy":
        """Make a fresh policy for the robot; PolicyError if there is none of that name.

        Args:
            name_or_path: See `policies.resolve`.
            trust: True to load files that can hide code.
            on_hardware_profile: True for scenarios on the robot's hardware profile. Our controllers then command the
                servo gains of the robot's maker.
            **options: Further options of the policy, for example `parameters`.

        Returns:
            The policy.
        """
        import policies
        from quad_env.actuation.hardware import hardware_profile

        target: dict[str, Any]
        if on_hardware_profile:
            profile = hardware_profile(self.robot_model)
            target = {"robot": self.robot_model.with_servo(), "actuator": profile.actuator, "sensors": profile.sensors}
        else:
            target = {"robot": self.robot_model, "actuator": self.actuator, "sensors": self.sensors}
        return policies.resolve(name_or_path, trust=trust, **target | options)

    @property
    def is_customized(self) -> bool:
        """True if actuator, sensors or estimator differ from the default."""
        return replace(self, robot=IDEAL.robot, servo="", simulator=IDEAL.simulator) != IDEAL


IDEAL = HardwareConfig()
"""Default hardware: SimpleQuad with ideal motors and the true state, in MuJoCo."""


def describe_hardware(hardware: HardwareConfig) -> str:
    """Return sentences on hardware that differs from the default: ` Robot: go1. Motors: motor; ...`."""
    text = ""
    if hardware.robot != IDEAL.robot:
        text += f" Robot: {hardware.robot}."
    if hardware.servo:
        text += f" Servos: {hardware.servo}."
    if hardware.simulator != IDEAL.simulator:
        text += f" Simulator: {hardware.simulator}."
    if hardware.is_customized:
        estimator = "" if hardware.estimator == IDEAL.estimator else f"; estimator: {hardware.estimator}"
        text += f" Motors: {hardware.actuator}; sensors: {hardware.sensors}{estimator}."
    return text


def parse_robot_option(robot: str, option: str = "--robot") -> HardwareConfig:
    """Parse a robot option.

    Args:
        robot: Name or path of the robot.
        option: Name of the option in the error message.

    Returns:
        The default hardware with that robot.

    Raises:
        UsageError: The robot does not exist.
    """
    hardware = HardwareConfig(robot=robot)
    try:
        check_hardware(hardware)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from error
    return hardware


def check_hardware(hardware: HardwareConfig, scenario: "Scenario | None" = None) -> None:
    """Check that the hardware exists and the simulator supports it; warn about a user's robot.

    Args:
        hardware: Hardware to check.
        scenario: Scenario to simulate; None for flat ground.

    Raises:
        ValueError: A name is unknown (with the valid names), a robot cannot be loaded, an estimator has no sensors,
            or the simulator does not support the scenario or the hardware.
    """
    from quad_env.actuation.models import find_actuator
    from quad_env.physics.simulators import check_simulator
    from quad_env.scenarios.scenario import Scenario
    from quad_env.sensing.estimators import check_estimator
    from quad_env.sensing.suite import sensor_suite

    try:
        robot = hardware.robot_model
    except (OSError, ImportError) as error:  # no file, or a package that is not installed
        raise ValueError(str(error)) from error
    if robot.source is not None:
        _print_warnings(robot)
    motors = find_actuator(hardware.actuator)
    suite = sensor_suite(hardware.sensors)
    check_estimator(hardware.estimator, suite)
    check_simulator(hardware.simulator, scenario or Scenario("flat"), motors, suite is not None, readings=True)


@lru_cache
def _print_warnings(robot: "Robot") -> None:
    """Print, once, the implausible properties of a user's robot."""
    from quad_env.robots.leg_names import find_contradictions
    from quad_env.robots.plausibility import find_warnings

    for line in (*find_contradictions(robot), *find_warnings(robot)):
        print(f"warning: {robot.name}: {line}", file=sys.stderr)
