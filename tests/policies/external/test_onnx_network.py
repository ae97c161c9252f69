"""Inputs and outputs of ONNX files are identified by name, in any order; ambiguous names are refused."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from policies.base import PolicyError
from policies.external import onnx_network
from tests.policies.external.small_networks import SmallNetwork

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

WIDTH = 5


def altered(
    file: Path,
    numbers: SmallNetwork,
    outputs: Sequence[str],
    renamed: dict[str, str] | None = None,
    inputs: Sequence[str] | None = None,
) -> Path:
    """Write a network with its outputs in a given order; unknown outputs are constants of the action's shape."""
    model = onnx.load(numbers.onnx(file))
    graph = model.graph
    known = {each.name: each for each in graph.output}
    width = {"value": 1, "values": 1}
    for name in outputs:
        if name not in known:
            shape = [1, width.get(name, 12)]
            tensor = onnx.numpy_helper.from_array(np.full(shape, 7.0, np.float32))
            graph.node.append(onnx.helper.make_node("Constant", [], [name], value=tensor))
            known[name] = onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)
    values = [known[name] for name in outputs]
    del graph.output[:]
    graph.output.extend(values)
    if inputs is not None:
        given = {each.name: each for each in graph.input}
        values = [given[name] for name in inputs]
        del graph.input[:]
        graph.input.extend(values)
    for old, new in (renamed or {}).items():
        for node in graph.node:
            node.input[:] = [new if name == old else name for name in node.input]
            node.output[:] = [new if name == old else name for name in node.output]
        for each in (*graph.input, *graph.output):
            each.name = new if each.name == old else each.name
    file.write_bytes(model.SerializeToString())
    return file


def check(file: Path, numbers: SmallNetwork) -> None:
    """Check that the file gives the network's actions, step by step."""
    make, has_memory = onnx_network.make_network_factory(onnx_network.open_session(file), file)
    act, expected = make(), numbers.make_act()
    assert has_memory == numbers.lstm
    for row in np.random.default_rng(1).standard_normal((6, WIDTH)).astype(np.float32):
        np.testing.assert_allclose(np.ravel(act(row)), expected(row), atol=1e-5)


@pytest.mark.parametrize(
    "outputs",
    [
        ("actions", "h_out", "c_out"),
        ("actions", "c_out", "h_out"),
        ("c_out", "h_out", "actions"),
        ("values", "h_out", "actions", "log_std", "c_out"),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("inputs", [("obs", "h_in", "c_in"), ("c_in", "obs", "h_in")], ids=" ".join)
def test_a_memory_is_renewed_by_name(tmp_path: Path, outputs: tuple[str, ...], inputs: tuple[str, ...]) -> None:
    numbers = SmallNetwork(WIDTH, lstm=True)
    check(altered(tmp_path / "net.onnx", numbers, outputs, inputs=inputs), numbers)


@pytest.mark.parametrize(
    "renamed",
    [
        {"h_in": "h0", "c_in": "c0", "h_out": "hn", "c_out": "cn"},
        {"h_in": "hidden", "c_in": "cell", "h_out": "next_hidden", "c_out": "next_cell"},
        {"h_in": "prevHidden", "c_in": "prevCell", "h_out": "hidden", "c_out": "cell", "obs": "observation"},
        {"h_in": "in_state_0", "c_in": "in_state_1", "h_out": "out_state_0", "c_out": "out_state_1"},
    ],
    ids=lambda names: names["h_in"],
)
def test_other_names_of_a_memory(tmp_path: Path, renamed: dict[str, str]) -> None:
    numbers = SmallNetwork(WIDTH, lstm=True)
    check(altered(tmp_path / "net.onnx", numbers, ("actions", "c_out", "h_out"), renamed), numbers)


@pytest.mark.parametrize(
    ("outputs", "name"),
    [
        (("mu", "log_std", "value"), "mu"),
        (("log_std", "value", "mu"), "mu"),
        (("values", "actions"), "actions"),
        (("mean", "std", "actions"), "actions"),
        (("value", "net_7"), "net_7"),
    ],
)
def test_what_a_network_gives_besides_its_action_is_left(tmp_path: Path, outputs: tuple[str, ...], name: str) -> None:
    numbers, here = SmallNetwork(WIDTH), [each if each != name else "actions" for each in outputs]
    check(altered(tmp_path / "net.onnx", numbers, here, {"actions": name}), numbers)


def test_what_names_do_not_decide_is_asked_for(tmp_path: Path) -> None:
    numbers = SmallNetwork(WIDTH)
    file = altered(tmp_path / "net.onnx", numbers, ("left", "actions"), {"actions": "right"})
    with pytest.raises(PolicyError, match="outputs left, right, and none is called actions"):
        onnx_network.make_network_factory(onnx_network.open_session(file), file)
    renamed = {"h_in": "a", "c_in": "b", "h_out": "x", "c_out": "y"}
    file = altered(tmp_path / "net.onnx", SmallNetwork(WIDTH, lstm=True), ("actions", "h_out", "c_out"), renamed)
    with pytest.raises(PolicyError, match="reads a besides the observation, and x, y may update it; name the output"):
        onnx_network.make_network_factory(onnx_network.open_session(file), file)
