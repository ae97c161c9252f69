"""The environment as text: the robot, spaces, actuators and sensors; `python -m quad_env info`."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from importlib.metadata import version

import quad_env
from quad_env.actuation.hardware import hardware_profile
from quad_env.actuation.models import ACTUATORS
from quad_env.config import FALL_REASONS, FALL_RULE, TaskConfig
from quad_env.robots.registry import parse_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.listing import RobotOptions
from quad_env.sensing.estimators import ESTIMATORS
from quad_env.sensing.suite import SENSORS, TRUTH
from quad_env.task.observations import observation_table


def main(options: RobotOptions) -> int:
    """Run the command `info`, which prints a description of the environment, and return its exit code.

    UsageError is raised for an unknown robot or an invalid file of a robot.
    """
    print(environment_text(parse_robot(options.robot)))
    return 0


def environment_text(robot: Robot = SIMPLE_QUAD) -> str:
    """Return a text that describes the environment with a robot: action, observation, reward and options.

    An empty line separates the sections.
    """
    sections = (_overview(robot), _action(robot), _observation(robot), _options())
    return "\n\n".join("\n".join(section) for section in sections)


def _overview(robot: Robot) -> Iterator[str]:
    """Yield lines of text about versions, the robot, its joints, its realistic hardware, and time limits."""
    task = TaskConfig()
    steps = quad_env.MAX_EPISODE_STEPS
    yield f"{quad_env.ENV_ID}  quad_env {quad_env.__version__}, MuJoCo {version('mujoco')}"
    yield (
        f"robot        {robot.name}: {robot.mass:g} kg, {robot.num_joints} joints, "
        f"trunk {robot.home_height:.2f} m high in the home pose"
    )
    joints = f"at most {robot.rated_torque:g} N·m, rated speed {robot.rated_speed:g} rad/s, servos {robot.servo}"
    yield f"joints       {joints}"
    actuator, sensors, estimator = hardware_profile(robot)
    if actuator.curve is not None:
        _, speeds, torques = actuator.curve.resolve(robot)
        speed = _format_range(speeds)
        torque = _format_range(torques)
        yield f"+hardware    at most {torque} N·m, {speed} rad/s without load;"
        yield f"             targets {1000.0 * actuator.delay:g} ms late, sensors {sensors}, estimator {estimator}"
    yield f"time         control at {task.control_rate:g} Hz, episodes of {steps / task.control_rate:g} s"


def _format_range(values: Iterable[float]) -> str:
    """Return the distinct numbers in `values` as text, in ascending order, such as `20 to 30`."""
    return " to ".join(f"{value:g}" for value in sorted({*map(float, values)}))


def _action(robot: Robot) -> Iterator[str]:
    """Yield lines of text about the action space of the environment with a robot."""
    yield f"action       float32, shape ({robot.num_joints},): target joint angles, rad"
    yield from joint_table(robot)


def joint_table(robot: Robot) -> Iterator[str]:
    """Yield the lines of a text table of the robot's joints: lower limit, home pose and upper limit, rad."""
    rows = zip(robot.joint_names, robot.joint_lower, robot.home_pose, robot.joint_upper, strict=True)
    width = max(16, *(len(name) + 1 for name in robot.joint_names))
    yield f"  {'joint':{width}}{'lower':>7}{'home':>7}{'upper':>7}"
    yield from (f"  {name:{width}}{lower:7.2f}{home:7.2f}{upper:7.2f}" for name, lower, home, upper in rows)


def _observation(robot: Robot) -> Iterator[str]:
    """Yield lines of text about the observation space of the environment with a robot, one line per term."""
    table = observation_table(robot)
    yield f"observation  float32, shape ({table.size},)"
    for term in table.terms:
        part = table.slices[term.name]
        yield f"  {f'{part.start}:{part.stop}':7}{term.name:20}±{term.bound:<7g}{term.unit}"


def _options() -> Iterator[str]:
    """Yield lines of text about reward weights, reasons of a fall, and arguments of `gym.make`."""
    yield "reward       weighted sum"
    yield from (f"  {weight:<+9g}{name}" for name, weight in asdict(TaskConfig().reward_weights).items())
    yield f"falls        rule {FALL_RULE}: {', '.join(FALL_REASONS[1:])}"
    yield f"actuator=    {', '.join(ACTUATORS)}"
    yield f"sensors=     {', '.join((TRUTH, *SENSORS))}"
    yield f"estimator=   {', '.join(ESTIMATORS)}"
    yield "scenario=    see python -m quad_env scenarios"
