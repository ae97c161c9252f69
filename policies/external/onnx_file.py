"""Policies as ONNX files: a network from one observation to one action, or the correction of a residual.

A residual is no function of the observation alone, since its base has a clock. So its file holds the network alone, and
as metadata the `policy.json` of its bundle, which says what the network reads, over which base, and how far it may
correct it. The runtime's sums are rounded otherwise than NumPy's, by 1e-7, of which rough ground makes another episode
within a second: so the residual of a file runs in NumPy, to the bit as its bundle does, once the runtime has agreed.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from policies import bundle
from policies.base import Policy, PolicyError
from policies.description import assembled, check_unaltered, network_of, parsed
from policies.external.onnx_roles import find_roles
from policies.external.packages import import_package
from policies.external.python_file import ActFactory, ActFunction
from policies.external.reference import PolicyReference
from policies.network import Network, Weights
from policies.residual import ResidualPolicy
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot

DESCRIPTION = "simple_quad_policy"
"""Key of the metadata that makes a file a residual."""
FEATURES, CORRECTION = "features", "correction"
"""Input and output of a residual's network."""
PROBES, TOLERANCE = 16, 1e-5
"""Features at which the runtime must give NumPy's corrections, and to within what."""
TYPES: dict[str, type[np.floating]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}
"""Kinds of numbers that a network may read."""
_OPSET, _IR_VERSION = 17, 8
"""Old ones, which every runtime reads."""


def load_onnx(reference: PolicyReference, robot: Robot) -> Policy | ActFactory:
    """A residual for the robot, if it is its own, or what gives the action for one observation. Raises PolicyError, one
    line."""
    session = open_session(reference.file)
    make, _ = make_network_factory(session, reference.file)
    description = session.get_modelmeta().custom_metadata_map.get(DESCRIPTION)
    return make if description is None else _residual(reference.file, description, make(), robot)


def open_session(file: Path) -> Any:
    """The file's network in the runtime. Raises PolicyError, one line."""
    runtime = import_package("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise PolicyError(f"{file} cannot be read as ONNX: {format_exception(error)}") from error


def make_network_factory(session: Any, file: Path) -> tuple[Callable[[], ActFunction], bool]:
    """Return the network of a session as a function from one observation to one action, and whether it has a memory.
    `onnx_roles` finds inputs and outputs by name. Raises PolicyError.
    """
    if not session.get_inputs() or not session.get_outputs() or not session.get_inputs()[0].shape:
        raise PolicyError(f"{file} has no input of an observation, a vector, or no output")
    roles = find_roles(session.get_inputs(), session.get_outputs(), file)
    seen = roles.observation
    states = [state for state, _ in roles.memory]
    shapes = [[size if isinstance(size, int) else 1 for size in state.shape] for state in states]
    if other := next((each for each in (seen, *states) if each.type not in TYPES), None):
        raise PolicyError(f"{file} reads {other.type}: it must read float or double")
    is_batch = len(seen.shape) == 2 and not isinstance(seen.shape[0], int)
    if not seen.shape or (seen.shape[:-1] not in ([], [1]) and not is_batch):
        raise PolicyError(f"{file} reads {seen.shape}: it must read one observation, or a batch of any size")
    names = [roles.action.name, *(renewed.name for _, renewed in roles.memory)]
    flat = len(seen.shape) == 1

    def make() -> ActFunction:
        memory = {state.name: np.zeros(shape, TYPES[state.type]) for state, shape in zip(states, shapes, strict=True)}

        def act(row: Weights) -> Any:
            shown = row.astype(TYPES[seen.type])
            found, *kept = session.run(names, {seen.name: shown if flat else shown[None]} | memory)
            memory.update(zip(memory, kept, strict=True))
            return found if flat or np.shape(found)[:1] != (1,) else found[0]

        return act

    return make, bool(states)


def _residual(file: Path, description: str, act: ActFunction, robot: Robot) -> ResidualPolicy:
    onnx = import_package("onnx")
    tensors = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(file).graph.initializer}
    found = parsed(file, description.encode())
    network = network_of(file, found.network, tensors)
    try:
        off = _difference(act, network, PROBES)
    except Exception as error:
        raise PolicyError(f"the network in {file} fails: {format_exception(error)}") from error
    if not off <= TOLERANCE:
        raise PolicyError(f"the network in {file} is not the one that its metadata describes; export it again")
    policy = assembled(file, found, network, robot)
    check_unaltered(file, description.encode())
    return policy


def _difference(act: ActFunction, network: Network, count: int) -> float:
    """Largest difference of the two networks' corrections over so many features; infinite for other shapes, and NaN for
    what is none."""
    features = np.random.default_rng(0).standard_normal((count, network.sizes[0])).astype(np.float32)
    found = np.array([act(row) for row in features])
    return float(np.abs(found - network(features)).max()) if found.shape == (count, network.sizes[-1]) else np.inf


def export_residual(folder: Path, file: Path, checked: int, robot: Robot | None = None) -> float:
    """Write the residual of a bundle's folder, for a robot as in `policies.load`, as ONNX; the largest difference of
    the file's corrections from the bundle's, over so many features. Raises PolicyError and OSError."""
    onnx, _ = import_package("onnx"), import_package("onnxruntime")
    network = bundle.load(folder, robot).network
    model = onnx.helper.make_model(
        _graph(onnx, network),
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="simple-quad",
    )
    description = bundle.folder_of(folder).joinpath(bundle.DESCRIPTION).read_text(encoding="utf-8")
    onnx.helper.set_model_props(model, {DESCRIPTION: description})
    onnx.checker.check_model(model)
    file.write_bytes(model.SerializeToString())
    make, _ = make_network_factory(open_session(file), file)
    found = _difference(make(), network, checked)
    if not found <= TOLERANCE:
        raise PolicyError(
            f"{file} answers otherwise than {folder}, by {found:.1g}: the runtime here is not to be trusted"
        )
    return found


def _graph(onnx: Any, network: Network) -> Any:
    """The network, a Gemm a layer and an activation between them."""
    nodes, values, last = [], FEATURES, len(network.weights) - 1
    tensors = [onnx.numpy_helper.from_array(each, name) for name, each in bundle.tensors(network).items()]
    for index in range(last + 1):
        sums = CORRECTION if index == last else f"{index}.sums"
        nodes.append(onnx.helper.make_node("Gemm", [values, f"{index}.weight", f"{index}.bias"], [sums]))
        if index < last:
            values = f"{index}.values"
            nodes.append(onnx.helper.make_node("Elu", [sums], [values]))
    ends = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["robots", width])
        for name, width in zip((FEATURES, CORRECTION), (network.sizes[0], network.sizes[-1]), strict=True)
    ]
    return onnx.helper.make_graph(nodes, "residual", ends[:1], ends[1:], tensors)
