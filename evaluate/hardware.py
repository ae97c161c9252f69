"""Hardware settings of the simulated robots: checks them, describes them, and makes policies for them.

The hardware is the robot, its servo gains, motors, sensors and state estimator, and the physics simulator. The
functions of this module import other packages only when they are called, because --help must be quick.
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
    """Settings of the simulated hardware: robot, servo gains, motors, sensors, estimator and simulator.

    Environments and policies of one evaluation or training run are made from the same object. Each field except `servo`
    has the name and the meaning of a keyword argument of `SimpleQuadVectorEnv`.
    """

    actuator: str = "ideal"
    """Name of the motor model; `ideal` for servo motors that have a torque limit and no other imperfection."""
    sensors: str = "truth"
    """Name of the sensor model; `truth` if the policy observes the true state."""
    estimator: str = "complementary"
    """Name of the state estimator that computes the observation from the readings of the sensors."""
    robot: str = "simple_quad"
    """Name of a built-in robot, or path of a file that describes a robot in MJCF, URDF or TOML."""
    servo: str = ""
    """Servo gains of the robot for this project's controllers: text `stiffness/damping`, N·m/rad and N·m·s/rad.

    The text `stiff` means the gains in the field `stiff_servo` of the robot. If the text is empty, each policy has its
    own servo gains.
    """
    simulator: str = "mujoco"
    """Name of the physics simulator, `mujoco` or `drake`."""

    @property
    def robot_model(self) -> "Robot":
        """Robot object that the field `robot` names, with the servo gains of the field `servo` if given.

        The property loads the robot. It raises ValueError if `servo` is not `stiffness/damping`, and the errors of
        `quad_env.robots.registry.get_robot` if the robot cannot be loaded.
        """
        from quad_env.robots.registry import get_robot
        from quad_env.robots.robot import STIFF

        robot = get_robot(self.robot)
        if not self.servo:
            return robot
        if self.servo == STIFF:
            return robot.with_servo(*robot.stiff_servo)
        try:
            stiffness, damping = map(float, self.servo.split("/"))
            return robot.with_servo(stiffness, damping)
        except ValueError:
            fact = f"servo is stiffness/damping above 0, such as 35/0.5, or {STIFF}"
            raise ValueError(f"{fact}; got {self.servo!r}") from None

    def env_kwargs(self, robot: "Robot") -> dict[str, Any]:
        """Return keyword arguments of `SimpleQuadVectorEnv` for an environment with this hardware.

        Args:
            robot: Robot of the policy. The environment's robot gets the servo gains of this robot.

        Returns:
            Name of the keyword argument -> value: actuator, sensors, estimator, simulator and robot.
        """
        robot_model = self.robot_model.with_servo(robot.servo_stiffness, robot.servo_damping)
        names = ("actuator", "sensors", "estimator", "simulator")
        return {name: getattr(self, name) for name in names} | {"robot": robot_model}

    def policy(
        self, name_or_path: str, trust: bool = False, *, on_hardware_profile: bool = False, **options: Any
    ) -> "Policy":
        """Make a new policy object for this hardware; raise PolicyError if the policy is unknown.

        Args:
            name_or_path: Name or path of the policy, as for `policies.resolve`.
            trust: True to load policy files that can run hidden code while they are loaded.
            on_hardware_profile: True to make the policy for scenarios with the hardware profile (models of the real
                robot's motors and sensors). This project's controllers then use the servo gains of the robot's
                manufacturer.
            **options: Further keyword arguments of the policy, for example `parameters`.

        Returns:
            The policy object.
        """
        import policies
        from quad_env.actuation.hardware import hardware_profile

        target: dict[str, Any]
        if on_hardware_profile:
            profile = hardware_profile(self.robot_model)
            target = {"robot": self.robot_model.with_servo(), "actuator": profile.actuator, "sensors": profile.sensors}
        else:
            target = {"robot": self.robot_model, "actuator": self.actuator, "sensors": self.sensors}
        return policies.resolve(name_or_path, trust=trust, servo="own", **target | options)

    @property
    def is_customized(self) -> bool:
        """True if the motor model, the sensor model or the state estimator is not the default of its field."""
        return replace(self, robot=IDEAL.robot, servo="", simulator=IDEAL.simulator) != IDEAL


@dataclass(frozen=True)
class ServosByRow(HardwareConfig):
    """Hardware configuration with different servo gains for each robot of a batch."""

    gains: Any = None
    """Stiffness, N·m/rad, and damping, N·m·s/rad, of the servos of n robots, (2, n, 12)."""

    def env_kwargs(self, robot: "Robot") -> dict[str, Any]:
        """Return the keyword arguments of an environment with the servo gains `gains`: name -> value.

        `robot` is the robot of the policy.
        """
        return super().env_kwargs(robot) | {"servo": tuple(self.gains)}

    def mean_robot(self) -> "Robot":
        """Return the robot model, with the mean of the servo gains over the n robots of the batch."""
        is_uniform = (self.gains == self.gains[:, :1]).all()
        return self.robot_model.with_servo(*(self.gains[:, 0] if is_uniform else self.gains.mean(axis=1)))


IDEAL = HardwareConfig()
"""Default hardware: the robot SimpleQuad with ideal motors, simulated by MuJoCo.

The policies observe the true state instead of the output of a state estimator.
"""


def describe_hardware(hardware: HardwareConfig) -> str:
    """Describe in words the settings of `hardware` that are not the default, for example ` Robot: go1.`.

    The text has sentences for these settings only, each with a space before it, so that it can be appended to another
    sentence. It is empty for the default hardware.
    """
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
    """Return default hardware with the robot that a user named in a command-line option.

    Args:
        robot: Value of the option: name of a built-in robot, or path of a file that describes a robot.
        option: Name of the option, for the error message.

    Returns:
        The default hardware (ideal motors, true state, MuJoCo) with this robot.

    Raises:
        UsageError: The robot does not exist or cannot be loaded.
    """
    hardware = HardwareConfig(robot=robot)
    try:
        check_hardware(hardware)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from error
    return hardware


def check_hardware(hardware: HardwareConfig, scenario: "Scenario | None" = None) -> None:
    """Check that the robot, motors, sensors, estimator and simulator of `hardware` exist and fit together.

    A robot from a user's file is also checked for plausibility. Implausible properties are printed as warnings.

    Args:
        hardware: Names of robot, servo gains, motors, sensors, estimator and simulator.
        scenario: Scenario that the simulator must support; None for flat ground.

    Raises:
        ValueError: A name is unknown (the message lists the valid names). The robot cannot be loaded. An estimator is
            named, although the policies observe the true state. The simulator does not support the scenario or the
            hardware.
    """
    from quad_env.actuation.models import find_actuator
    from quad_env.physics.simulators import check_simulator
    from quad_env.scenarios.scenario import Scenario
    from quad_env.sensing.estimators import check_estimator
    from quad_env.sensing.suite import sensor_suite

    try:
        robot = hardware.robot_model
    except (OSError, ImportError) as error:  # The robot's file or a required package is missing.
        raise ValueError(str(error)) from error
    if robot.source is not None:
        _print_warnings(robot)
    motors = find_actuator(hardware.actuator)
    suite = sensor_suite(hardware.sensors)
    check_estimator(hardware.estimator, suite)
    check_simulator(hardware.simulator, scenario or Scenario("flat"), motors, suite is not None, readings=True)


@lru_cache
def _print_warnings(robot: "Robot") -> None:
    """Print warnings about implausible properties of a user's `robot` on stderr, once for each robot."""
    from quad_env.robots.leg_names import find_contradictions
    from quad_env.robots.plausibility import find_warnings

    for line in (*find_contradictions(robot), *find_warnings(robot)):
        print(f"warning: {robot.name}: {line}", file=sys.stderr)
