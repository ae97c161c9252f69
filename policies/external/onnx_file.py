"""Policies in ONNX files: a network, or the correction of a residual policy.

The network maps one observation to one action.

A residual policy adds a network's correction to the action of a base policy. Its action depends on more than the
observation, because the base policy has a clock. Therefore its file holds the network and, as metadata, the
`policy.json` of its bundle (policy folder): network inputs, base policy and limits of the correction.

The ONNX runtime rounds sums differently from NumPy, by 1e-7. On rough ground this difference changes the episode within
a second. Therefore a residual policy is computed in NumPy, with the same bits as its bundle. When the file is loaded,
the output of NumPy is compared with the output of the runtime.
"""

from pathlib import Path
from typing import Any

import numpy as np

from policies import bundle
from policies.base import Policy, PolicyError
from policies.description import assemble_policy, build_network, check_unaltered, parse_description
from policies.external.act_function import ActFactory, ActFunction
from policies.external.onnx_network import RESIDUAL_METADATA, make_network_factory, open_session
from policies.external.packages import import_package
from policies.external.reference import PolicyReference
from policies.network import Network
from policies.residual import ResidualPolicy
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot

FEATURES = "features"
"""Name of the network's input in the file of a residual policy."""
CORRECTION = "correction"
"""Name of the network's output in the file of a residual policy."""
PROBE_COUNT = 16
"""Number of random feature vectors on which the runtime and NumPy are compared at loading."""
TOLERANCE = 1e-5
"""Maximum difference between the corrections by runtime and NumPy, as a fraction of the authority.

The authority is the limit of the correction.
"""
_OPSET = 17
"""ONNX opset version of exported files; all supported runtimes read it."""
_IR_VERSION = 8
"""ONNX format version of exported files; all supported runtimes read it."""


def load_onnx(reference: PolicyReference, robot: Robot) -> Policy | ActFactory:
    """Load a policy from an ONNX file.

    Raises PolicyError if the file is not a policy, or is a residual policy for another robot.

    Args:
        reference: Reference to the file.
        robot: Robot that a residual policy moves.

    Returns:
        Residual policy, or a factory of functions from one observation to one action.
    """
    session = open_session(reference.file)
    make, _ = make_network_factory(session, reference.file)
    description = session.get_modelmeta().custom_metadata_map.get(RESIDUAL_METADATA)
    return make if description is None else _load_residual(reference.file, description, make(), robot)


def _load_residual(file: Path, description: str, act: ActFunction, robot: Robot) -> ResidualPolicy:
    """Return the residual policy in a file, after a comparison of NumPy with the runtime.

    The `description` is the text of the bundle's `policy.json`; `act` is the network in the runtime.
    """
    onnx = import_package("onnx")
    tensors = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(file).graph.initializer}
    parsed_description = parse_description(file, description.encode())
    network = build_network(file, parsed_description.network, tensors)
    try:
        difference = _max_difference(act, network, PROBE_COUNT)
    except Exception as error:
        raise PolicyError(f"the network in {file} fails: {format_exception(error)}") from error
    if not difference <= TOLERANCE:
        raise PolicyError(f"the network in {file} is not the one that its metadata describes; export it again")
    policy = assemble_policy(file, parsed_description, network, robot)
    check_unaltered(file, description.encode())
    return policy


def _max_difference(act: ActFunction, network: Network, count: int) -> float:
    """Return the largest difference between the outputs of `act` and `network` for random features.

    The result is infinite if the shapes of the outputs differ, and NaN if an output is NaN.
    """
    features = np.random.default_rng(0).standard_normal((count, network.sizes[0])).astype(np.float32)
    corrections = np.array([act(row) for row in features])
    if corrections.shape != (count, network.sizes[-1]):
        return np.inf
    return float(np.abs(corrections - network(features)).max())


def export_residual(folder: Path, file: Path, probe_count: int, robot: Robot | None = None) -> float:
    """Write the residual policy of a bundle as an ONNX file, and compare the outputs of file and bundle.

    Args:
        folder: Folder of the bundle.
        file: ONNX file to write.
        probe_count: Number of random feature vectors of the comparison.
        robot: Robot that the policy moves, as in `policies.load`.

    Returns:
        Largest difference between the corrections, as a fraction of the authority.

    Raises:
        PolicyError: The folder has no residual policy, or the difference exceeds TOLERANCE.
    """
    onnx = import_package("onnx")
    import_package("onnxruntime")
    network = bundle.load(folder, robot).network
    model = onnx.helper.make_model(
        _graph(onnx, network),
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="simple-quad",
    )
    description = bundle.find_bundle_folder(folder).joinpath(bundle.DESCRIPTION).read_text(encoding="utf-8")
    onnx.helper.set_model_props(model, {RESIDUAL_METADATA: description})
    onnx.checker.check_model(model)
    file.write_bytes(model.SerializeToString())
    make, _ = make_network_factory(open_session(file), file)
    difference = _max_difference(make(), network, probe_count)
    if not difference <= TOLERANCE:
        raise PolicyError(
            f"{file}: output differs from {folder} by {difference:.1g} (limit {TOLERANCE:g})",
            "check your onnxruntime installation",
        )
    return difference


def _graph(onnx: Any, network: Network) -> Any:
    """Return the network as an ONNX graph, with one Gemm per layer and an Elu activation between layers."""
    nodes = []
    values = FEATURES
    last = len(network.weights) - 1
    tensors = [onnx.numpy_helper.from_array(each, name) for name, each in bundle.network_tensors(network).items()]
    for index in range(last + 1):
        sums = CORRECTION if index == last else f"{index}.sums"
        nodes.append(onnx.helper.make_node("Gemm", [values, f"{index}.weight", f"{index}.bias"], [sums]))
        if index < last:
            values = f"{index}.values"
            nodes.append(onnx.helper.make_node("Elu", [sums], [values]))
    inputs_and_outputs = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["robots", width])
        for name, width in zip((FEATURES, CORRECTION), (network.sizes[0], network.sizes[-1]), strict=True)
    ]
    return onnx.helper.make_graph(nodes, "residual", inputs_and_outputs[:1], inputs_and_outputs[1:], tensors)
