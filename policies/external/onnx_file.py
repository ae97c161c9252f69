"""Policies in ONNX files: a network, or the correction of a residual policy.

A plain network maps one observation of the environment to one action.

A residual policy adds the output of a network, the correction, to the action of a base policy. The action depends on
more than the observation, because the base policy has a clock. The file of a residual policy therefore contains the
network and, as metadata, the `policy.json` of its bundle (policy folder). `policy.json` defines the network inputs, the
base policy and the limits of the correction.

Sums in the ONNX runtime and in NumPy have different rounding errors, of about 1e-7. On rough ground this difference
changes the episode within a second. A residual policy is therefore computed in NumPy, with the same bits as its bundle.
When the file is loaded, the output of NumPy is compared with the output of the ONNX runtime.
"""

from collections.abc import Mapping
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
from policies.network import LIMIT, Network
from policies.residual import ResidualPolicy
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot

FEATURES = "features"
"""Name of the network's input in the ONNX file of a residual policy."""
CORRECTION = "correction"
"""Name of the network's output in the ONNX file of a residual policy."""
PROBE_COUNT = 16
"""Number of random network inputs for which ONNX runtime and NumPy are compared when a file is loaded."""
TOLERANCE = 5e-5
"""Maximum difference between the outputs of ONNX runtime and NumPy for the network of a residual policy.

ONNX runtime computes in float32. A sum of 300 terms in a layer, limited to ±64, then has a rounding error of up to
about 64 · 2⁻²⁴ · √300 = 7e-5; the errors of 1e-5 that were seen are of networks with large weights.

The outputs are corrections of the joint targets, as fractions of the authority (the limit of the correction). If the
largest output is above 1, the difference is divided by the largest output.
"""
_OPSET = 17
"""Version of the ONNX operator set in exported files; all supported ONNX runtimes can read it."""
_IR_VERSION = 8
"""Version of the ONNX file format of exported files; all supported ONNX runtimes can read it."""


def load_onnx(reference: PolicyReference, robot: Robot) -> Policy | ActFactory:
    """Load a policy from an ONNX file without a specification: a plain network or a residual policy.

    Raises PolicyError if the file contains no policy, or contains a residual policy for another robot.

    Args:
        reference: Reference to the ONNX file.
        robot: Robot that the policy moves.

    Returns:
        Residual policy, or a function without arguments that returns a function from one observation to one action.
    """
    session = open_session(reference.file)
    make, _ = make_network_factory(session, reference.file)
    description = session.get_modelmeta().custom_metadata_map.get(RESIDUAL_METADATA)
    return make if description is None else _load_residual(reference.file, description, make(), robot)


def _load_residual(file: Path, description: str, act: ActFunction, robot: Robot) -> ResidualPolicy:
    """Load the residual policy in an ONNX file, and compare its network in NumPy with the ONNX runtime.

    `description` is the text of the bundle's `policy.json`. `act` calls the network in the ONNX runtime. Raises
    PolicyError if the outputs differ by more than TOLERANCE.
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
    """Return the largest difference between the outputs of `act` and `network` for random inputs.

    `act` and `network` are called with `count` random inputs. If the largest output of `network` for an input is above
    1, the difference is divided by it. The result is infinite if the shapes of the outputs differ, and NaN if an output
    is NaN.
    """
    features = np.random.default_rng(0).standard_normal((count, network.sizes[0])).astype(np.float32)
    corrections = np.array([act(row) for row in features])
    if corrections.shape != (count, network.sizes[-1]):
        return np.inf
    expected = network(features)
    scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1.0)
    return float((np.abs(corrections - expected) / scale).max())


def export_residual(folder: Path, file: Path, probe_count: int, robot: Robot | None = None) -> float:
    """Export the residual policy of a bundle (policy folder) to an ONNX file, and check the file.

    Args:
        folder: Folder of the bundle.
        file: ONNX file to write.
        probe_count: Number of random network inputs for which file and bundle are compared.
        robot: Robot that the policy moves, as in `policies.load`.

    Returns:
        Largest difference between the network outputs of file and bundle, as a fraction of the authority (the limit of
        the correction), or of the largest output if this is larger.

    Raises:
        PolicyError: The folder contains no residual policy, or the difference exceeds TOLERANCE.
    """
    onnx = import_package("onnx")
    import_package("onnxruntime")
    network = bundle.load(folder, robot).network
    description = bundle.find_bundle_folder(folder).joinpath(bundle.DESCRIPTION).read_text(encoding="utf-8")
    save_graph(_graph(onnx, network), {RESIDUAL_METADATA: description}, file)
    make, _ = make_network_factory(open_session(file), file)
    difference = _max_difference(make(), network, probe_count)
    if not difference <= TOLERANCE:
        raise PolicyError(
            f"{file}: output differs from {folder} by {difference:.1g} (limit {TOLERANCE:g})",
            "check your onnxruntime installation",
        )
    return difference


def save_graph(graph: Any, metadata: Mapping[str, str], file: Path) -> None:
    """Write an ONNX graph to a file.

    Args:
        graph: Graph, a GraphProto of the package onnx.
        metadata: Entries of the metadata of the file: key -> text.
        file: File to write.
    """
    onnx = import_package("onnx")
    model = onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="simple-quad",
    )
    onnx.helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model)
    file.write_bytes(model.SerializeToString())


def _graph(onnx: Any, network: Network) -> Any:
    """Return a network as an ONNX graph: one Gemm operator per layer, and Elu activations between layers.

    A Clip operator limits the inputs of each layer to ±LIMIT, as `Network` does.
    """
    limits = {"limit.lower": -LIMIT, "limit.upper": LIMIT}
    nodes = [onnx.helper.make_node("Constant", [], [name], value_float=value) for name, value in limits.items()]
    layer_inputs = FEATURES
    last = len(network.weights) - 1
    tensors = [onnx.numpy_helper.from_array(each, name) for name, each in bundle.network_tensors(network).items()]
    for index in range(last + 1):
        clipped = f"{index}.clipped"
        nodes.append(onnx.helper.make_node("Clip", [layer_inputs, *limits], [clipped]))
        sums = CORRECTION if index == last else f"{index}.sums"
        nodes.append(onnx.helper.make_node("Gemm", [clipped, f"{index}.weight", f"{index}.bias"], [sums]))
        if index < last:
            layer_inputs = f"{index}.values"
            nodes.append(onnx.helper.make_node("Elu", [sums], [layer_inputs]))
    inputs_and_outputs = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["robots", width])
        for name, width in zip((FEATURES, CORRECTION), (network.sizes[0], network.sizes[-1]), strict=True)
    ]
    return onnx.helper.make_graph(nodes, "residual", inputs_and_outputs[:1], inputs_and_outputs[1:], tensors)
