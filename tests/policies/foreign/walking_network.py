"""A network that trots on SimpleQuad, as ONNX, and its true description: fitted to `trot`, with feedback of its own.

At any phase the trot's targets are linear in the velocity that it is to have, and so are the network's, whose features
of the clock are fitted by least squares. It steers by the velocity that it observes, and levels the trunk by gravity:
so wrong frames and signs cost it its way or its balance.
"""

from pathlib import Path

import numpy as np
import pytest

import policies
from policies.foreign.description import PolicyDescription, Term
from policies.legs.kinematics import joint_angles
from quad_env import OBSERVATION, OBSERVATION_SIZE, SIMPLE_QUAD

onnx = pytest.importorskip("onnx")

FEATURES, STEEP, STEPS, ROBOTS, SETTLED = 50, 4.0, 50, 40, 40
ACTION_SCALE = 0.25
FEEDBACK = np.array([1.5, 1.5, 0.0])
"""Of the velocity's error, added to the command."""
LEVELLING, HEIGHT = 0.5, 0.18
"""Share of what would level the trunk by which the legs on its lower side reach further; and m for gravity's size."""
ORDER = [3 * leg + link for link in range(3) for leg in (1, 0, 3, 2)]
"""The robot's joints in the order of the policy: by kind, and FR FL HR HL."""
TERMS = {
    "linear_velocity": 2.0,
    "angular_velocity": 0.25,
    "projected_gravity": 1.0,
    "command": 1.0,
    "joint_position": 1.0,
    "joint_velocity": 0.05,
    "previous_action": 1.0,
}
"""Name and scale."""
DEFAULT = SIMPLE_QUAD.home_pose + 0.1
"""rad, in the robot's order."""


def write(file: Path) -> PolicyDescription:
    """Write the network; its description."""
    trot = policies.make("trot")
    terms = [Term(name, (scale,)) for name, scale in TERMS.items()] + [Term("gait_clock", clock=trot.frequency)]
    found = PolicyDescription(
        network=file,
        control_rate=50.0,
        joints=tuple(SIMPLE_QUAD.joint_names[joint] for joint in ORDER),
        default_position=tuple(DEFAULT[ORDER].tolist()),
        action_scale=(ACTION_SCALE,) * 12,
        stiffness=(float(np.mean(SIMPLE_QUAD.servo_stiffness)),) * 12,
        damping=(float(np.mean(SIMPLE_QUAD.servo_damping)),) * 12,
        terms=tuple(terms),
    )
    ends = np.cumsum([term.width for term in terms])
    places = {term.name: np.arange(end - term.width, end) for term, end in zip(terms, ends, strict=True)}
    file.write_bytes(_model(*_weights(trot, places, found.width)).SerializeToString())
    return found


def _weights(trot: policies.Trot, places: dict[str, np.ndarray], width: int) -> tuple[np.ndarray, ...]:
    """Of the clock's features, of the velocity to have, of their products and of the observation itself."""
    rng = np.random.default_rng(0)
    turning = STEEP * rng.standard_normal((2, FEATURES)), STEEP * rng.standard_normal(FEATURES)
    clocks, velocities = np.zeros((width, FEATURES)), np.zeros((width, 4))
    clocks[places["gait_clock"]] = turning[0]
    for axis in range(3):
        velocities[places["command"][axis], axis] = 1.0 + FEEDBACK[axis]
        velocities[places["linear_velocity"][axis], axis] = -FEEDBACK[axis] / TERMS["linear_velocity"]
    phases, commands, targets = _walked(trot, rng)
    shown = np.stack((np.sin(phases), np.cos(phases)), axis=1)
    products = _products(np.tanh(shown @ turning[0] + turning[1]), commands)
    actions = (targets - DEFAULT)[:, ORDER] / ACTION_SCALE
    fitted = np.linalg.lstsq(products, actions, rcond=None)[0]
    direct, reach, gravity = np.zeros((width, 12)), _reach(trot), places["projected_gravity"]
    along, across, _ = LEVELLING * SIMPLE_QUAD.hip_positions.T
    for place, way in zip(gravity, (along, across, np.full(4, HEIGHT)), strict=True):
        direct[place] = (way[:, None] * reach).ravel()[ORDER] / ACTION_SCALE
    return clocks, turning[1], velocities, fitted, direct, direct[gravity[2]]


def _walked(trot: policies.Trot, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Phases (n,), velocities (n, 4), the last number 1, and targets (n, 12) of the trot at its settled commands."""
    commands = rng.uniform((-0.8, -0.6, -1.5), (1.2, 0.6, 1.5), (ROBOTS, 3))
    shown = np.zeros((ROBOTS, OBSERVATION_SIZE), np.float32)
    shown[:, OBSERVATION["command"]] = commands
    trot.reset(ROBOTS)
    steps = [(trot.act(shown), trot.phase) for _ in range(SETTLED + STEPS)][SETTLED:]
    targets, phases = (np.concatenate(each) for each in zip(*steps, strict=True))
    return phases, np.tile(np.hstack((commands, np.ones((ROBOTS, 1)))), (STEPS, 1)), targets.astype(float)


def _reach(trot: policies.Trot) -> np.ndarray:
    """How the joints of a standing leg move as its foot reaches 1 m further down, (4, 3), rad/m."""
    parameters, up = trot.parameters, np.array((0.0, 0.0, 0.005))
    feet = np.full((4, 3), (parameters.stance_shift, 0.0, -parameters.body_height))
    feet[:, 1] = SIMPLE_QUAD.side * SIMPLE_QUAD.hip_offset
    return (joint_angles(SIMPLE_QUAD, feet - up) - joint_angles(SIMPLE_QUAD, feet + up)) / 0.01


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
