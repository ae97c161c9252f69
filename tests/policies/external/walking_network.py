"""Networks that trot, as ONNX with correct specifications: fitted to `trot`, with additional feedback.

The trot's targets at a given phase are linear in the desired velocity. The networks use the same form, with clock
features fitted by least squares. They correct the velocity error if they observe the velocity. They level the trunk by
gravity and gyro, damp the joints, and smooth their actions. Wrong frames, signs, scales and orders therefore reduce
their distance or their balance. Each network has its own robot, joint order, term order, scales, signs, rate and
history.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.external.spec import PolicySpec, SpecTerm
from policies.legs.kinematics import joint_angles
from quad_env import OBSERVATION, OBSERVATION_SIZE, Robot
from quad_env.robots.registry import get_robot

onnx = pytest.importorskip("onnx")

FEATURES, STEEP, STEPS, ROBOTS, SETTLED = 50, 4.0, 50, 40, 40


@dataclass(frozen=True)
class Style:
    """Inputs and outputs of a network. Joints are in the robot's order unless stated otherwise."""

    robot: str = "simple_quad"
    legs: tuple[int, ...] = (1, 0, 3, 2)
    """Order of the legs in the policy's joint order."""
    is_by_kind: bool = True
    terms: dict[str, tuple[float, ...]] = field(
        default_factory=lambda: {
            "linear_velocity": (2.0,),
            "angular_velocity": (0.25,),
            "projected_gravity": (1.0,),
            "command": (1.0,),
            "joint_position": (1.0,),
            "joint_velocity": (0.05,),
            "previous_action": (1.0,),
        }
    )
    """Term name -> scale."""
    action_scale: float = 0.25
    rate: float = 50.0
    """Control rate, Hz."""
    history: int = 1
    """Number of steps in the history, by time, newest first."""
    turned: tuple[int, ...] = ()
    """Links, 0 to 2, with joints of reversed direction."""
    is_scaled: bool = False
    """True if the previous action is in rad."""
    default: float = 0.1
    """Default position relative to the home pose, rad."""
    steering: float = 1.5
    """Gain on the velocity error, added to the command."""
    levelling: float = 0.5
    """Leg extension on the lower side, as a share of the full levelling of the trunk."""
    rate_levelling: float = 0.04
    """Leg extension per angular velocity of the trunk, as a share of the full levelling, s."""
    joint_damping: float = 0.003
    """Gain on the joint speeds, s."""
    smoothing: float = 0.2
    """Share of the previous action in an action."""

    @property
    def order(self) -> list[int]:
        """Return the robot's joints in the policy's order."""
        if self.is_by_kind:
            return [3 * leg + link for link in range(3) for leg in self.legs]
        return [3 * leg + link for leg in self.legs for link in range(3)]


LEVELLED = Style()
REMEMBERING = Style(
    robot="go2",
    is_by_kind=False,
    terms={
        "command": (2.0, 2.0, 0.25),
        "linear_velocity": (2.0,),
        "angular_velocity": (0.25,),
        "projected_gravity": (1.0,),
        "joint_position": (1.0,),
        "joint_velocity": (0.05,),
        "previous_action": (1.0,),
    },
    history=8,
    default=0.0,
    rate_levelling=0.08,
    joint_damping=0.004,
)
MIRRORED = Style(
    legs=(0, 1, 2, 3),
    is_by_kind=False,
    terms={
        "linear_velocity": (1.0,),
        "angular_velocity": (0.25,),
        "projected_gravity": (1.0,),
        "joint_position": (1.0,),
        "joint_velocity": (0.05,),
        "previous_action": (1.0,),
        "command": (1.0,),
    },
    action_scale=0.5,
    rate=100 / 3,
    turned=(1, 2),
    is_scaled=True,
    steering=2.5,
)
STYLES = {"levelled": LEVELLED, "remembering": REMEMBERING, "mirrored": MIRRORED}
HEIGHT = 0.18
"""m. Leg extension per unit of projected gravity, which balances the levelling."""


def write(file: Path, style: Style = LEVELLED) -> PolicySpec:
    """Write the network and return its specification."""
    robot = get_robot(style.robot)
    trot = policies.make("trot", robot=robot, servo="own")
    terms = [SpecTerm(name, scale, history=style.history) for name, scale in style.terms.items()]
    terms.append(SpecTerm("gait_clock", clock=trot.frequency, history=style.history))
    signs = _signs(style)
    default = (signs * (robot.home_pose + style.default))[style.order]
    found = PolicySpec(
        network=file,
        control_rate=style.rate,
        joints=tuple(robot.joint_names[joint] for joint in style.order),
        default_position=tuple(default.tolist()),
        action_scale=(style.action_scale,) * 12,
        stiffness=(float(np.mean(trot.robot.servo_stiffness)),) * 12,
        damping=(float(np.mean(trot.robot.servo_damping)),) * 12,
        terms=tuple(terms),
        history_layout="time" if style.history > 1 else "term",
        history_newest="first" if style.history > 1 else "last",
        previous_action="scaled" if style.is_scaled else "raw",
        signs=tuple(signs[style.order].tolist()) if style.turned else None,
    )
    ends = np.cumsum([term.width for term in terms])
    places = {term.name: np.arange(end - term.width, end) for term, end in zip(terms, ends, strict=True)}
    file.write_bytes(_model(*_weights(trot, style, places, int(ends[-1]))).SerializeToString())
    return found


def _signs(style: Style) -> np.ndarray:
    """Return the signs of the policy's joints relative to the robot's, (12,), in the robot's order."""
    return np.where(np.isin(np.arange(12) % 3, style.turned), -1.0, 1.0)


def _scale(style: Style, name: str) -> np.ndarray:
    """Return the scale of each value of a term."""
    width = 12 if name.startswith(("joint", "previous")) else 3
    return np.broadcast_to(style.terms[name], width)


def _weights(trot: policies.Trot, style: Style, places: dict[str, np.ndarray], step: int) -> tuple[np.ndarray, ...]:
    """Return the weights of the clock features, of the desired velocity, of their products and of the observation.

    The newest step of the history is the first `step` numbers of the observation.
    """
    rng, robot = np.random.default_rng(0), trot.robot
    signs, width = _signs(style), step * style.history
    turning = STEEP * rng.standard_normal((2, FEATURES)), STEEP * rng.standard_normal(FEATURES)
    clocks, velocities = np.zeros((width, FEATURES)), np.zeros((width, 4))
    clocks[places["gait_clock"]] = turning[0]
    steering = style.steering * np.array([1.0, 1.0, 0.0]) * ("linear_velocity" in places)
    for axis in range(3):
        velocities[places["command"][axis], axis] = (1.0 + steering[axis]) / _scale(style, "command")[axis]
        if "linear_velocity" in places:
            seen = places["linear_velocity"][axis]
            velocities[seen, axis] = -steering[axis] / _scale(style, "linear_velocity")[axis]
    phases, commands, targets = _walked(trot, rng)
    shown = np.stack((np.sin(phases), np.cos(phases)), axis=1)
    products = _products(np.tanh(shown @ turning[0] + turning[1]), commands)
    in_rad = style.action_scale if not style.is_scaled else 1.0
    actions = (signs * (targets - robot.home_pose - style.default))[:, style.order] / style.action_scale
    actions *= 1.0 - style.smoothing
    fitted = np.linalg.lstsq(products, actions, rcond=None)[0]
    direct, reach, gravity = np.zeros((width, 12)), _reach(trot), places["projected_gravity"]
    along, across, _ = style.levelling * robot.hip_positions.T
    for place, way in zip(gravity, (along, across, np.full(4, HEIGHT)), strict=True):
        direct[place] = (signs * (way[:, None] * reach).ravel())[style.order] / style.action_scale
    along, across, _ = style.rate_levelling * robot.hip_positions.T
    for place, way, scale in zip(
        places["angular_velocity"], (-across, along), _scale(style, "angular_velocity"), strict=False
    ):
        direct[place] = (signs * (way[:, None] * reach).ravel())[style.order] / style.action_scale / scale
    speeds = places["joint_velocity"], _scale(style, "joint_velocity")
    direct[speeds[0], np.arange(12)] = -style.joint_damping / style.action_scale / speeds[1]
    previous = style.smoothing * in_rad / style.action_scale
    direct[places["previous_action"], np.arange(12)] = previous / _scale(style, "previous_action")
    return clocks, turning[1], velocities, fitted, direct, direct[gravity[2]]


def _walked(trot: policies.Trot, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return phases (n,), velocities with a constant 1 (n, 4), and targets (n, 12) of the trot at settled commands."""
    commands = rng.uniform((-0.8, -0.6, -1.5), (1.2, 0.6, 1.5), (ROBOTS, 3))
    shown = np.zeros((ROBOTS, OBSERVATION_SIZE), np.float32)
    shown[:, OBSERVATION["command"]] = commands
    trot.reset(ROBOTS)
    steps = [(trot.act(shown), trot.phase) for _ in range(SETTLED + STEPS)][SETTLED:]
    targets, phases = (np.concatenate(each) for each in zip(*steps, strict=True))
    return phases, np.tile(np.hstack((commands, np.ones((ROBOTS, 1)))), (STEPS, 1)), targets.astype(float)


def _reach(trot: policies.Trot) -> np.ndarray:
    """Return the change of the joint angles of a standing leg per downward motion of its foot, (4, 3), rad/m."""
    parameters, up, robot = trot.parameters, np.array((0.0, 0.0, 0.005)), trot.robot
    feet = np.full((4, 3), (parameters.stance_shift, 0.0, -parameters.body_height))
    feet[:, 1] = _side(robot) * robot.hip_offset
    return (joint_angles(robot, feet - up) - joint_angles(robot, feet + up)) / 0.01


def _side(robot: Robot) -> np.ndarray:
    return np.asarray(robot.side, float)


def _products(features: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    return (features[:, :, None] * velocities[:, None, :]).reshape(len(features), -1)


def _model(clocks, bias, velocities, fitted, direct, offset):
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    count = len(bias)
    tensors = {
        "clocks": clocks,
        "bias": bias,
        "velocities": velocities,
        "one": np.eye(4)[3],
        "repeat": np.repeat(np.eye(count), 4, axis=1),
        "tile": np.tile(np.eye(4), (1, count)),
        "fitted": fitted,
        "direct": direct,
        "offset": offset,
    }
    nodes = [
        helper.make_node("Gemm", ["obs", "clocks", "bias"], ["turned"]),
        helper.make_node("Tanh", ["turned"], ["features"]),
        helper.make_node("Gemm", ["obs", "velocities", "one"], ["velocity"]),
        helper.make_node("MatMul", ["features", "repeat"], ["left"]),
        helper.make_node("MatMul", ["velocity", "tile"], ["right"]),
        helper.make_node("Mul", ["left", "right"], ["products"]),
        helper.make_node("MatMul", ["products", "fitted"], ["trot"]),
        helper.make_node("Gemm", ["obs", "direct", "offset"], ["level"]),
        helper.make_node("Add", ["trot", "level"], ["actions"]),
    ]
    ends = [
        helper.make_tensor_value_info(name, kind, ["n", width])
        for name, width in (("obs", len(clocks)), ("actions", 12))
    ]
    weights = [onnx.numpy_helper.from_array(np.ascontiguousarray(v, np.float32), name) for name, v in tensors.items()]
    graph = helper.make_graph(nodes, "trot", ends[:1], ends[1:], weights)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
