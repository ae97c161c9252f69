"""Writers of a plain network as ONNX and as TorchScript: input `obs`, (1, inputs), output `actions`, (1, 12)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from policies.external.onnx_file import save_graph
from policies.external.packages import check_package, import_package
from policies.network import LIMIT
from train.export.plain_network import PlainNetwork

INPUT = "obs"
"""Name of the input of an ONNX file, as rsl_rl, mjlab and Unitree's programs call it."""
OUTPUT = "actions"
"""Name of the output of an ONNX file, as rsl_rl, mjlab and Unitree's programs call it."""


def write_onnx(network: PlainNetwork, file: Path, metadata: Mapping[str, str] | None = None) -> None:
    """Write a plain network to an ONNX file.

    Args:
        network: Plain network.
        file: File to write; its folder is made if it is missing.
        metadata: Entries of the metadata of the file: key -> text; None for no metadata.
    """
    onnx = import_package("onnx")
    file.parent.mkdir(parents=True, exist_ok=True)
    save_graph(_graph(onnx, network), metadata or {}, file)


def _graph(onnx: Any, network: PlainNetwork) -> Any:
    """Return the ONNX graph: Gemm and Elu of each layer, the limits of a bundle's layers, and the output limits."""
    limits = {"layer.min": -LIMIT, "layer.max": LIMIT}
    nodes = [onnx.helper.make_node("Constant", [], [name], value_float=value) for name, value in limits.items()]
    last = len(network.weights) - 1
    values = INPUT if network.gate is None else "gated"
    if network.gate is not None:
        nodes += _gate_nodes(onnx)
    for index in range(last + 1):
        sums = f"{index}.sums"
        nodes.append(onnx.helper.make_node("Gemm", [values, f"{index}.weight", f"{index}.bias"], [sums]))
        if index < last:
            nodes.append(onnx.helper.make_node("Elu", [sums], [f"{index}.elu"]))
            values = f"{index}.values"
            nodes.append(onnx.helper.make_node("Clip", [f"{index}.elu", *limits], [values]))
    nodes.append(onnx.helper.make_node("Max", [f"{last}.sums", "action.min"], ["above.min"]))
    nodes.append(onnx.helper.make_node("Min", ["above.min", "action.max"], [OUTPUT]))
    tensors = [
        onnx.numpy_helper.from_array(np.ascontiguousarray(value, np.float32), name)
        for name, value in _tensors(network).items()
    ]
    inputs, outputs = (
        [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, width])]
        for name, width in ((INPUT, len(network.weights[0])), (OUTPUT, len(network.biases[-1])))
    )
    return onnx.helper.make_graph(nodes, "policy", inputs, outputs, tensors)


def _gate_nodes(onnx: Any) -> list[Any]:
    """Return the nodes that hide the clock at rest, see `PlainNetwork.gate`."""
    return [
        onnx.helper.make_node("Abs", [INPUT], ["magnitudes"]),
        onnx.helper.make_node("Gemm", ["magnitudes", "gate.weight", "gate.bias"], ["motion"]),
        onnx.helper.make_node("Sign", ["motion"], ["is_shown"]),
        onnx.helper.make_node("Mul", [INPUT, "is_shown"], ["gated"]),
    ]


def _tensors(network: PlainNetwork) -> dict[str, Any]:
    """Return the constants of the ONNX graph: name -> array."""
    layers = enumerate(zip(network.weights, network.biases, strict=True))
    tensors = {
        f"{index}.{kind}": value
        for index, layer in layers
        for kind, value in zip(("weight", "bias"), layer, strict=True)
    }
    if network.gate is not None:
        tensors |= {"gate.weight": network.gate, "gate.bias": network.gate_bias}
    return tensors | {"action.min": network.min_action[None], "action.max": network.max_action[None]}


def write_torchscript(network: PlainNetwork, file: Path) -> None:
    """Write a plain network to a TorchScript file.

    Args:
        network: Plain network.
        file: File to write; its folder is made if it is missing.
    """
    check_package("torch", "train")
    # The module is imported here, because the import of torch takes seconds.
    from train.export.torch_module import save_torchscript

    file.parent.mkdir(parents=True, exist_ok=True)
    save_torchscript(network, file)
