"""Networks of specifications: batches, memories, and files that contain no network."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from policies.base import PolicyError
from policies.external.networks import BatchedNetwork, load_network
from policies.external.spec import SpecTerm
from tests.policies.external.small_networks import SmallNetwork, make_spec

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

TERMS = (SpecTerm("joint_velocity"), SpecTerm("command"))
WIDTH = 15


def load(file: Path) -> BatchedNetwork:
    return load_network(make_spec(file, TERMS))


@pytest.fixture
def rows() -> np.ndarray:
    return np.random.default_rng(0).standard_normal((20, WIDTH)).astype(np.float32)


def altered(file: Path, change: Callable[[Any], None]) -> Path:
    """Return the path of the ONNX file after a change of its graph."""
    model = onnx.load(file)
    change(model.graph)
    file.write_bytes(model.SerializeToString())
    return file


@pytest.mark.parametrize("batch", ["n", 1])
def test_a_row_has_the_same_bits_whatever_is_next_to_it(batch: int | str, tmp_path: Path, rows) -> None:
    def mix(graph: Any) -> None:
        mean = onnx.helper.make_node("ReduceMean", ["last_one"], ["mean"], axes=[0], keepdims=1)
        graph.node[-1].output[0] = "last_one"
        graph.node.extend([mean, onnx.helper.make_node("Add", ["last_one", "mean"], ["actions"])])

    mixed = load(altered(SmallNetwork(WIDTH).onnx(tmp_path / "p.onnx", batch), mix))
    mixed.reset(20)
    found, act = mixed.compute_actions(rows, np.arange(20)), SmallNetwork(WIDTH).make_act()
    np.testing.assert_allclose(found, [2.0 * act(row) for row in rows], atol=1e-5)
    np.testing.assert_array_equal(mixed.compute_actions(rows[7:8], np.array([0])), found[7:8])


@pytest.mark.parametrize("kind", ["onnx", "torchscript"])
def test_a_restart_of_one_robot_leaves_the_memories_of_the_others(kind: str, tmp_path: Path, rows) -> None:
    if kind == "torchscript":
        pytest.importorskip("torch")
    numbers = SmallNetwork(WIDTH, lstm=True)
    found = load(numbers.onnx(tmp_path / "p.onnx", 1) if kind == "onnx" else numbers.torchscript(tmp_path / "p.pt"))
    assert found.has_memory
    found.reset(3)
    acts = [numbers.make_act() for _ in range(3)]
    for step in range(6):
        if step == 3:
            found.reset_where(np.array([False, True, False]))
            acts[1] = numbers.make_act()
        who = np.array([0, 1, 2] if step % 2 else [2, 1])
        expected = [acts[robot](rows[3 * step + robot]) for robot in who]
        np.testing.assert_allclose(found.compute_actions(rows[3 * step + who], who), expected, atol=1e-6)


def test_a_torchscript_that_keeps_its_memory_to_itself(tmp_path: Path, rows) -> None:
    torch = pytest.importorskip("torch")
    from tests.policies.external import torch_modules

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.jit.script(torch_modules.Counting(WIDTH)).save(str(tmp_path / "p.pt"))
    found = load(tmp_path / "p.pt")
    assert found.has_memory
    found.reset(2)
    for step in (1, 2, 3):
        np.testing.assert_allclose(
            found.compute_actions(rows[:2], np.arange(2))[:, 0], rows[:2].sum(axis=1) + step, rtol=1e-5
        )


def external(graph: Any) -> None:
    onnx.external_data_helper.set_external_data(graph.initializer[0], location="weights.bin")
    graph.initializer[0].ClearField("raw_data")


def short(graph: Any) -> None:
    graph.output[0].type.tensor_type.shape.dim[1].dim_value = 16
    graph.node[-1].input[0], graph.node[-1].op_type = "inner", "Identity"
    del graph.node[-1].input[1]


def unknown_state(graph: Any) -> None:
    graph.input.append(onnx.helper.make_tensor_value_info("time_step", onnx.TensorProto.FLOAT, [1, 1]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (external, "cannot be read as ONNX"),
        (short, "gives 16 numbers of type float32 for the 12 joints"),
        (unknown_state, "reads time_step besides the observation, and no output updates"),
    ],
)
def test_what_is_no_network_of_a_policy_is_refused_in_words(change: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=words):
        load(altered(SmallNetwork(WIDTH).onnx(tmp_path / "p.onnx"), change))


def test_a_checkpoint_is_no_torchscript_and_runs_no_code(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    touched = tmp_path / "touched"

    class Harmful:
        def __reduce__(self) -> Any:
            return Path.touch, (touched,)

    torch.save({"weights": Harmful()}, tmp_path / "p.pt")
    with pytest.raises(PolicyError, match=r"p\.pt is a checkpoint, not TorchScript.*a checkpoint holds weights alone"):
        load(tmp_path / "p.pt")
    assert not touched.exists()
