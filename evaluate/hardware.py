"""What the robots of a run are built of. It imports no package, for the options are to be shown quickly."""

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
    """Names that the environment's keyword arguments of the same names know."""

    actuator: str = "ideal"
    sensors: str = "truth"
    estimator: str = "complementary"
    robot: str = "simple_quad"
    """Or the path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos for all our controllers, N·m/rad and N·m·s/rad; by default each has its own."""
    simulator: str = "mujoco"
    """Simulator of the physics, one of `quad_env.physics.simulators.SIMULATORS`."""

    @property
    def robot_model(self) -> "Robot":
        """The robot of that name, with those servos. Raises as `quad_env.robots.registry.robot_of`."""
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
        """Keyword arguments of an environment of the robot, with the servo gains of one that a policy is made for."""
        own = self.robot_model.with_servo(robot.servo_stiffness, robot.servo_damping)
        names = ("actuator", "sensors", "estimator", "simulator")
        return {name: getattr(self, name) for name in names} | {"robot": own}

    def policy(
        self, name_or_path: str, trust: bool = False, *, on_hardware_profile: bool = False, **given: Any
    ) -> "Policy":
        """A fresh policy for that robot, by name or path, see `policies.resolve`; PolicyError if there is none.

        One `on_hardware_profile` is for scenarios on it: our controllers command the robot's own servo gains.
        What else is `given` goes to what makes it, such as `parameters`.
        """
        import policies
        from quad_env.actuation.hardware import hardware_profile

        made: dict[str, Any] = {"robot": self.robot_model, "actuator": self.actuator, "sensors": self.sensors}
        if on_hardware_profile:
            profile = hardware_profile(self.robot_model)
            made = {"robot": self.robot_model.with_servo(), "actuator": profile.actuator, "sensors": profile.sensors}
        return policies.resolve(name_or_path, trust=trust, **made | given)

    @property
    def is_customized(self) -> bool:
        """Whether actuator, sensors or estimator are other than the usual ones."""
        return replace(self, robot=IDEAL.robot, servo="", simulator=IDEAL.simulator) != IDEAL


IDEAL = HardwareConfig()


def describe_hardware(hardware: HardwareConfig) -> str:
    """` Robot: go1. Motors: motor; sensors: typical.`, an unusual estimator named too; nothing of what is usual."""
    robot = "" if hardware.robot == IDEAL.robot else f" Robot: {hardware.robot}."
    robot += f" Servos: {hardware.servo}." if hardware.servo else ""
    robot += "" if hardware.simulator == IDEAL.simulator else f" Simulator: {hardware.simulator}."
    if not hardware.is_customized:
        return robot
    estimator = "" if hardware.estimator == IDEAL.estimator else f"; estimator: {hardware.estimator}"
    return f"{robot} Motors: {hardware.actuator}; sensors: {hardware.sensors}{estimator}."


def parse_robot_option(robot: str, option: str = "--robot") -> HardwareConfig:
    """The robot of that name or path, otherwise as usual. Raises UsageError."""
    try:
        check_hardware(found := HardwareConfig(robot=robot))
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from error
    return found


def check_hardware(hardware: HardwareConfig, scenario: "Scenario | None" = None) -> None:
    """ValueError, which lists the valid names, where one is unknown, a robot cannot be had, an estimator has no sensors
    or the simulator cannot do that, in that scenario."""
    from quad_env.actuation.models import actuator
    from quad_env.physics.simulators import check_simulator
    from quad_env.scenarios.scenario import Scenario
    from quad_env.sensing.estimators import check_estimator
    from quad_env.sensing.suite import sensor_suite

    try:
        robot = hardware.robot_model
    except (OSError, ImportError) as error:  # no file, or a package that is not installed
        raise ValueError(str(error)) from error
    if robot.source is not None:
        _warn(robot)
    motors, suite = actuator(hardware.actuator), sensor_suite(hardware.sensors)
    check_estimator(hardware.estimator, suite)
    check_simulator(hardware.simulator, scenario or Scenario("flat"), motors, suite is not None, readings=True)


@lru_cache
def _warn(robot: "Robot") -> None:
    """Print, once, what is hard to believe about a user's robot."""
    from quad_env.robots.leg_names import find_contradictions
    from quad_env.robots.plausibility import find_warnings

    for line in (*find_contradictions(robot), *find_warnings(robot)):
        print(f"warning: {robot.name}: {line}", file=sys.stderr)
