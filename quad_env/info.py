"""What the environment consists of, as text for a terminal: robot, spaces, scenarios, actuators, sensors."""

from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version

import quad_env
from quad_env.actuation.models import ACTUATORS
from quad_env.config import FALL_REASONS, FALL_RULE, TaskConfig
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import Axis, axes_of
from quad_env.sensing.estimators import ESTIMATORS
from quad_env.sensing.suite import SENSORS, TRUTH
from quad_env.task.observations import observation_table


def text(robot: Robot = SIMPLE_QUAD) -> str:
    """Everything, in parts with a line between."""
    return "\n\n".join(
        "\n".join(part) for part in (_head(robot), _action(robot), _observation(robot), _rest(), _axes(robot))
    )


def _head(robot: Robot) -> Iterator[str]:
    task, steps = TaskConfig(), quad_env.MAX_EPISODE_STEPS
    yield f"{quad_env.ENV_ID}  quad_env {quad_env.__version__}, MuJoCo {version('mujoco')}"
    yield (
        f"robot        {robot.name}: {robot.mass:g} kg, {robot.num_joints} joints, "
        f"trunk {robot.home_height:.2f} m high in the home pose"
    )
    yield (
        f"joints       at most {robot.rated_torque:g} N·m, rated speed {robot.rated_speed:g} rad/s, servos "
        f"{robot.servo_stiffness:g} N·m/rad and {robot.servo_damping:g} N·m·s/rad"
    )
    yield f"time         control at {task.control_rate:g} Hz, episodes of {steps / task.control_rate:g} s"


def _action(robot: Robot) -> Iterator[str]:
    yield f"action       float32, shape ({robot.num_joints},): target joint angles, rad"
    yield from joint_table(robot)


def joint_table(robot: Robot) -> Iterator[str]:
    """Limits and home pose of its joints, rad."""
    rows = zip(robot.joint_names, robot.joint_lower, robot.home_pose, robot.joint_upper, strict=True)
    width = max(16, *(len(name) + 1 for name in robot.joint_names))
    yield f"  {'joint':{width}}{'lower':>7}{'home':>7}{'upper':>7}"
    yield from (f"  {name:{width}}{lower:7.2f}{home:7.2f}{upper:7.2f}" for name, lower, home, upper in rows)


def _observation(robot: Robot) -> Iterator[str]:
    table = observation_table(robot)
    yield f"observation  float32, shape ({table.size},)"
    for term in table.terms:
        part = table.slices[term.name]
        yield f"  {f'{part.start}:{part.stop}':7}{term.name:20}±{term.bound:<7g}{term.unit}"


def _rest() -> Iterator[str]:
    yield "reward       weighted sum"
    yield from (f"  {weight:<+9g}{name}" for name, weight in asdict(TaskConfig().reward_weights).items())
    yield f"falls        rule {FALL_RULE}: {', '.join(FALL_REASONS[1:])}"
    yield f"actuator=    {', '.join(ACTUATORS)}"
    yield f"sensors=     {', '.join((TRUTH, *SENSORS))}"
    yield f"estimator=   {', '.join(ESTIMATORS)}"


def _axes(robot: Robot) -> Iterator[str]:
    yield "scenario=    name, its severity, and the levels of its axis (push:3 is the third)"
    yield from map(_axis, axes_of(robot).values())


def scenarios(robot: Robot = SIMPLE_QUAD) -> str:
    """Every scenario with its severities and a sentence; how severities are written."""
    return "\n".join((*_scenarios(robot), "", *_spellings(robot)))


def _scenarios(robot: Robot) -> Iterator[str]:
    yield f"for {robot.name}: name, its severity, the levels of its axis from mild to hard, and what happens"
    for axis in axes_of(robot).values():
        yield _axis(axis)
        yield f"  {'':13}{axis.sentence}"


EXAMPLES = {
    "push": "the nominal severity of the axis",
    "push:3": "the third of its levels",
    "push=42": "that severity, in the unit of the axis",
    "payload=15+slope=10": "several at once, joined by +",
    "push:all": "every level; of python -m evaluate --scenarios alone, as are the next two",
    "quick": "a battery of scenarios; so are default, full and all",
    "my_file.py:NAME": "a quad_env.Scenario of yours, in a file",
}
"""What scenarios are written as, and what that means."""


def _spellings(robot: Robot) -> Iterator[str]:
    yield "where a scenario is asked for, write"
    yield from (f"  {written:21}{meaning}" for written, meaning in EXAMPLES.items())


def _axis(axis: Axis) -> str:
    unit = f" {axis.unit}" if axis.unit not in ("", "°") else axis.unit
    levels = " ".join(f"{level:.4g}" for level in axis.levels)
    return f"  {axis.name:13}{f'{axis.nominal:.4g}{unit}':12}{axis.quantity}: {levels}"
