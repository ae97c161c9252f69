"""Policies as ONNX files: a network from one observation to one action, or the correction of a residual.

A residual is no function of the observation alone, since its base has a clock. So its file holds the network alone, and
as metadata the `policy.json` of its bundle, which says what the network reads, over which base, and how far it may
correct it. The runtime's sums are rounded otherwise than NumPy's, by 1e-7, of which rough ground makes another episode
within a second: so the residual of a file runs in NumPy, to the bit as its bundle does, once the runtime has agreed.
"""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from policies import bundle
from policies.base import Policy, PolicyError
from policies.description import assembled, network_of, parsed
from policies.foreign.python_file import Maker
from policies.foreign.reference import Reference
from policies.network import Network, Weights
from policies.residual import ResidualPolicy
from quad_env.files.text import described
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


def load(reference: Reference, robot: Robot) -> Policy | Maker:
    """A residual for the robot, if it is its own, or what gives the action for one observation. Raises PolicyError, one
    line."""
    model = _opened(reference)
    description = model.session.get_modelmeta().custom_metadata_map.get(DESCRIPTION)
    if description is not None:
        return _residual(reference.file, description, model, robot)
    return lambda: model.one


def package(name: str) -> Any:
    """The package of that name; PolicyError where it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError:
        raise PolicyError(f'ONNX files need {name}, which is not here: pip install -e ".[onnx]"') from None


def session_of(file: Path) -> Any:
    """The file's network in the runtime. Raises PolicyError, one line."""
    runtime = package("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise PolicyError(f"{file} cannot be read as ONNX: {described(error)}") from error


def _opened(reference: Reference) -> "_Model":
    session = session_of(reference.file)
    return _Model(session, *_input(session, reference))


@dataclass(frozen=True)
class _Model:
    """A model that is shown one robot at a time, so that no bit depends on the others."""

    session: Any
    name: str
    rank: int
    kind: type[np.floating]

    def one(self, values: Weights) -> Any:
        """The first output for one row of inputs, without the axis of the batch."""
        row = values.astype(self.kind)
        (found, *_) = self.session.run(None, {self.name: row if self.rank == 1 else row[None]})
        return found if self.rank == 1 or np.shape(found)[:1] != (1,) else found[0]


def _input(session: Any, reference: Reference) -> tuple[str, int, type[np.floating]]:
    """Name, rank and type of the only input."""
    inputs = session.get_inputs()
    if len(inputs) != 1:
        names = ", ".join(each.name for each in inputs)
        raise PolicyError(f"{reference} has the inputs {names}: it must have one, the observation")
    shape = list(inputs[0].shape)
    if len(shape) not in (1, 2) or (len(shape) == 2 and isinstance(shape[0], int) and shape[0] != 1):
        raise PolicyError(f"{reference} reads {shape}: it must read one observation, or a batch of any size")
    if inputs[0].type not in TYPES:
        raise PolicyError(f"{reference} reads {inputs[0].type}: it must read float or double")
    return inputs[0].name, len(shape), TYPES[inputs[0].type]


def _residual(file: Path, description: str, model: _Model, robot: Robot) -> ResidualPolicy:
    onnx = package("onnx")
    tensors = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(file).graph.initializer}
    found = parsed(file, description.encode())

    def network(inputs: int, outputs: int) -> Network:
        network = network_of(file, found["network"], tensors, inputs, outputs)
        try:
            off = _difference(model, network, PROBES)
        except Exception as error:
            raise PolicyError(f"the network in {file} fails: {described(error)}") from error
        if not off <= TOLERANCE:
            raise PolicyError(f"the network in {file} is not the one that its metadata describes; export it again")
        return network

    return assembled(file, found, network, robot)


def _difference(model: _Model, network: Network, count: int) -> float:
    """Largest difference of the two networks' corrections over so many features; infinite for other shapes, and NaN for
    what is none."""
    features = np.random.default_rng(0).standard_normal((count, network.sizes[0])).astype(np.float32)
    found = np.array([model.one(row) for row in features])
    return float(np.abs(found - network(features)).max()) if found.shape == (count, network.sizes[-1]) else np.inf


def export(folder: Path, file: Path, checked: int, robot: Robot | None = None) -> float:
    """Write the residual of a bundle's folder, for a robot as in `policies.load`, as ONNX; the largest difference of
    the file's corrections from the bundle's, over so many features. Raises PolicyError and OSError."""
    onnx, _ = package("onnx"), package("onnxruntime")
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
    found = _difference(_opened(Reference(file)), network, checked)
    if not found <= TOLERANCE:
        raise PolicyError(
            f"{file} answers otherwise than {folder}, by {found:.1g}: the runtime here is not to be trusted"
        )
    return found


def _graph(onnx: Any, network: Network) -> Any:
    """The network, a Gemm a layer and an activation between them."""
    nodes, tensors, values = [], [], FEATURES
    last = len(network.weights) - 1
    for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        names = [f"{index}.weight", f"{index}.bias"]
        tensors += [_tensor(onnx, *each) for each in zip(names, (weight, bias), strict=True)]
        sums = CORRECTION if index == last else f"{index}.sums"
        nodes.append(onnx.helper.make_node("Gemm", [values, *names], [sums]))
        if index < last:
            values = f"{index}.values"
            nodes.append(onnx.helper.make_node("Elu", [sums], [values]))
    ends = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["robots", width])
        for name, width in zip((FEATURES, CORRECTION), (network.sizes[0], network.sizes[-1]), strict=True)
    ]
    return onnx.helper.make_graph(nodes, "residual", ends[:1], ends[1:], tensors)


def _tensor(onnx: Any, name: str, values: Weights) -> Any:
    return onnx.numpy_helper.from_array(np.ascontiguousarray(values), name)
