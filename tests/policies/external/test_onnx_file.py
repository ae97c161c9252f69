"""ONNX files: a network from one observation to one action, and the export of a residual policy with its base."""

from pathlib import Path

import numpy as np
import pytest

import policies
from policies.base import CONTROL_PERIOD, PolicyError
from policies.bundle import save
from policies.external import onnx_file
from policies.external.reference import PolicyReference
from policies.external.server import PolicyServer, make_server
from policies.network import LIMIT, Network
from policies.residual import ResidualPolicy
from quad_env import OBSERVATION_SIZE, SIMPLE_QUAD

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")


def served(file: Path) -> PolicyServer:
    return make_server(PolicyReference(file), SIMPLE_QUAD, CONTROL_PERIOD, 5.0)


def linear(file: Path, shape: list[int | str], *, width: int = 12, inputs: int = 1) -> np.ndarray:
    """Write a network `observation @ weights` for observations of a shape, and return the weights."""
    weights = np.random.default_rng(0).standard_normal((OBSERVATION_SIZE, width)).astype(np.float32) / 100
    kind = onnx.TensorProto.FLOAT
    seen = [onnx.helper.make_tensor_value_info(f"seen{number}", kind, shape) for number in range(inputs)]
    action = onnx.helper.make_tensor_value_info("action", kind, [*shape[:-1], width])
    node = onnx.helper.make_node("MatMul", ["seen0", "weights"], ["action"])
    graph = onnx.helper.make_graph([node], "g", seen, [action], [onnx.numpy_helper.from_array(weights, "weights")])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    file.write_bytes(model.SerializeToString())
    return weights


@pytest.mark.parametrize("shape", [[48], [1, 48], ["n", 48]], ids=str)
def test_a_network_gives_a_robot_the_same_bits_in_any_batch(tmp_path: Path, shape: list[int | str]) -> None:
    weights = linear(tmp_path / "net.onnx", shape)
    of = served(tmp_path / "net.onnx")
    seen = np.random.default_rng(1).standard_normal((5, OBSERVATION_SIZE)).astype(np.float32)
    of.reset(5, 0)
    actions = of.step(seen).actions
    np.testing.assert_allclose(actions, seen @ weights, atol=1e-5)
    of.reset(1, 0)
    np.testing.assert_array_equal(of.step(seen[3:4]).actions[0], actions[3])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"shape": [4, 48]}, r"\[4, 48\]: it must read one observation"),
        ({"shape": ["n", 48], "width": 3}, r"must give an action \(12,\)"),
        ({"shape": ["n", 48], "inputs": 2}, "reads seen1 besides the observation"),
    ],
    ids=lambda value: str(value)[:24],
)
def test_what_is_no_policy_is_refused(tmp_path: Path, arguments: dict, words: str) -> None:
    linear(tmp_path / "net.onnx", **arguments)
    with pytest.raises(PolicyError, match=words):
        served(tmp_path / "net.onnx")


def test_what_is_no_onnx_is_refused(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"nothing")
    with pytest.raises(PolicyError, match="cannot be read as ONNX"):
        served(tmp_path / "net.onnx")


def test_the_exported_residual_is_the_residual(tmp_path: Path, repository: Path) -> None:
    assert onnx_file.export_residual(repository / "models/residual", tmp_path / "residual.onnx", 50) < 1e-5
    of, residual = served(tmp_path / "residual.onnx"), policies.make("residual")
    random = np.random.default_rng(2)
    of.reset(3, 0)
    residual.reset(3)
    for _ in range(20):
        seen = random.standard_normal((3, OBSERVATION_SIZE)).astype(np.float32)
        answer = of.step(seen)
        np.testing.assert_array_equal(answer.actions, residual.act(seen))
        np.testing.assert_array_equal(answer.signals["correction"], residual.correction)


def test_a_policy_without_bounds_and_with_large_outputs_is_exported(tmp_path: Path) -> None:
    """Outputs of about 1000 differ by more than 1e-5 between two runtimes; the limit is relative to them."""
    base = policies.make("stand")
    rng = np.random.default_rng(0)
    weights = [rng.normal(0.0, scale, shape).astype(np.float32) for scale, shape in ((1.0, (48, 64)), (30.0, (64, 12)))]
    network = Network(tuple(weights), (np.zeros(64, np.float32), np.zeros(12, np.float32)))
    policy = ResidualPolicy(base, network, np.full(12, 1e-3, np.float32), bounded=False)
    save(tmp_path / "bundle", policy, {}, "unknown")
    onnx_file.export_residual(tmp_path / "bundle", tmp_path / "policy.onnx", 50)
    of, seen = served(tmp_path / "policy.onnx"), rng.standard_normal((3, OBSERVATION_SIZE)).astype(np.float32)
    of.reset(3, 0)
    policy.reset(3)
    np.testing.assert_array_equal(of.step(seen).actions, policy.act(seen))
    assert np.abs(policy.correction).max() > 100.0


def test_an_export_that_answers_otherwise_than_its_bundle_is_refused(
    tmp_path: Path, repository: Path, monkeypatch
) -> None:
    make = onnx.helper.make_node

    def node(kind: str, *rest: list[str], **attributes: float) -> onnx.NodeProto:
        return make({"Elu": "Tanh"}.get(kind, kind), *rest, **attributes)

    monkeypatch.setattr(onnx.helper, "make_node", node)
    with pytest.raises(PolicyError, match=r"residual\.onnx: output differs from .*check your onnxruntime"):
        onnx_file.export_residual(repository / "models/residual", tmp_path / "residual.onnx", 50)


def test_a_residual_whose_network_is_another_than_its_weights_is_refused(tmp_path: Path, repository: Path) -> None:
    file = tmp_path / "residual.onnx"
    onnx_file.export_residual(repository / "models/residual", file, 1)
    model = onnx.load(file)
    next(node for node in model.graph.node if node.op_type == "Elu").op_type = "Tanh"
    file.write_bytes(model.SerializeToString())
    with pytest.raises(PolicyError, match="not the one that its metadata describes"):
        served(file)


def test_an_export_limits_the_inputs_of_layers_as_the_network_does(tmp_path: Path) -> None:
    """Large weights, as of a network with a folded normalisation, drive the sums of a layer beyond the limit."""
    random = np.random.default_rng(0)
    weights = tuple(random.standard_normal(shape).astype(np.float32) * 9.0 for shape in ((30, 16), (16, 16), (16, 12)))
    biases = tuple(np.zeros(each.shape[1], np.float32) for each in weights)
    network = Network(weights, biases)
    model = onnx.helper.make_model(
        onnx_file._graph(onnx, network), opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8
    )
    (tmp_path / "net.onnx").write_bytes(model.SerializeToString())
    inputs = random.standard_normal((50, 30)).astype(np.float32)
    session = onnx_file.open_session(tmp_path / "net.onnx")
    outputs = session.run(None, {onnx_file.FEATURES: inputs})[0]
    expected = network(inputs)
    assert np.abs(inputs @ weights[0]).max() > LIMIT
    np.testing.assert_allclose(outputs, expected, atol=1e-5 * np.abs(expected).max())
