"""Functions that write mutated files into an empty folder, for the fuzz test of the file readers.

A mutated file is a valid file with random changes of its values or bytes.
"""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from policies import bundle
from policies.external.packages import import_package
from policies.shipped import MODELS
from research.fuzzing import samples
from research.fuzzing.mutations import mutate_bytes, mutate_tree, mutate_xml

Rng = np.random.Generator
Write = Callable[[Path, Rng], Path]
"""Type of a function that writes a mutated file (valid file with random changes).

The function takes an empty folder and a random generator, and returns the path of the written file.
"""
BYTES_SHARE = 0.2
"""Probability that the writer of a mutated file changes random bytes of the file.

A writer is a function that writes a valid file with random changes. Most writers change values of the file's content
if they do not change bytes. The functions `write_onnx` and `write_mjlab` always change values of the content.
"""
METADATA_BYTES_SHARE = 0.5
"""Probability that `write_mjlab` changes random bytes in one metadata text of an ONNX file.

The metadata describe a policy, as the training framework mjlab writes them.
"""
ARRAY_SHARE = 0.4
"""Probability that random bytes change in the header of the NumPy file with the heights of a terrain."""
MAX_METADATA = 5000
"""Maximum length of a metadata text in a written ONNX file, characters; a longer text is cut."""
_NPY_HEADER = 128
"""Size of the header of a NumPy file (.npy), bytes."""
_OPERATORS = ("Identity", "RandomNormalLike", "Loop", "Gemm", "Tanh", "Shape", "NoSuch", "Reshape", "Tile", "Exp")
"""Names of ONNX operators that replace the operator of a network node; `NoSuch` does not exist."""


def settings_writer(tree: Any, name: str, network: str = "exported/policy.onnx") -> Write:
    """Return a function that writes a settings file with random changes, and an empty network file.

    Args:
        tree: Valid content of the settings file.
        name: Path of the settings file relative to the folder; the suffix determines the format.
        network: Path relative to the folder of an empty file, which replaces the file of the policy's neural network.

    Returns:
        Function that writes the files into a folder and returns the path of the settings file.
    """

    def write(folder: Path, rng: Rng) -> Path:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        (folder / network).parent.mkdir(parents=True, exist_ok=True)
        (folder / network).touch()
        if rng.random() < BYTES_SHARE:
            file.write_bytes(mutate_bytes(_to_text(tree, file.suffix), rng, _change_count(rng)))
        else:
            file.write_bytes(_to_text(mutate_tree(tree, rng, _change_count(rng)), file.suffix))
        return file

    return write


def xml_writer(source: Path, name: str) -> Write:
    """Return a function that writes an XML file with random changes.

    Args:
        source: Valid XML file.
        name: Path of the changed file relative to the folder.

    Returns:
        Function that writes the file into a folder and returns its path.
    """

    def write(folder: Path, rng: Rng) -> Path:
        file = folder / name
        if rng.random() < BYTES_SHARE:
            file.write_bytes(mutate_bytes(source.read_bytes(), rng, _change_count(rng)))
        else:
            root = mutate_xml(ElementTree.fromstring(source.read_bytes()), rng, _change_count(rng))
            file.write_bytes(ElementTree.tostring(root))
        return file

    return write


def write_rl_sar(folder: Path, rng: Rng) -> Path:
    """Write `config.yaml` and `base.yaml` of the deployment software rl_sar, one with random changes.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of `config.yaml`.
    """
    config, base = samples.RL_SAR
    changed_file = int(rng.integers(3))  # 0 means config.yaml; 1 and 2 mean base.yaml.
    file = settings_writer(config, "go2/lab/config.yaml", "go2/lab/policy.onnx")(folder, rng)
    if changed_file:
        file.write_bytes(_to_text(config, ".yaml"))
    settings_writer(base, "go2/base.yaml", "go2/lab/policy.onnx")(folder, rng)
    if changed_file == 0:
        (folder / "go2/base.yaml").write_bytes(_to_text(base, ".yaml"))
    return file


def write_mjlab(folder: Path, rng: Rng) -> Path:
    """Write an ONNX file with metadata of the training framework mjlab that are changed at random.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of the ONNX file.
    """
    tree = mutate_tree(samples.MJLAB, rng, _change_count(rng))
    metadata = {str(key): str(value)[:MAX_METADATA] for key, value in tree.items()}
    if rng.random() < METADATA_BYTES_SHARE:
        key = list(metadata)[rng.integers(len(metadata))]
        metadata[key] = mutate_bytes(metadata[key].encode(), rng, _change_count(rng)).decode(errors="replace")
    return _write_content(_make_network(metadata).SerializeToString(), folder / "policy.onnx", rng)


def write_onnx(folder: Path, rng: Rng) -> Path:
    """Write an ONNX file with random changes of its network graph.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of the ONNX file.
    """
    model = _make_network({})
    for _ in range(_change_count(rng)):
        _mutate_graph(model.graph, rng)
    return _write_content(model.SerializeToString(), folder / "policy.onnx", rng)


def _write_content(content: bytes, file: Path, rng: Rng) -> Path:
    """Write `content` into `file`, in some cases with random changes of its bytes, and return `file`.

    The probability of these changes is 0.2 (BYTES_SHARE). `rng` is the random generator.
    """
    file.write_bytes(mutate_bytes(content, rng) if rng.random() < BYTES_SHARE else content)
    return file


def _make_network(metadata: dict[str, str]) -> Any:
    """Return a valid ONNX model with 48 inputs, one layer and 12 outputs; `metadata` is name -> text."""
    onnx = import_package("onnx")
    kind = onnx.TensorProto.FLOAT
    weights = onnx.numpy_helper.from_array(np.full((48, 12), 0.01, np.float32), "weights")
    bias = onnx.numpy_helper.from_array(np.zeros(12, np.float32), "bias")
    nodes = [
        onnx.helper.make_node("Gemm", ["obs", "weights", "bias"], ["sum"]),
        onnx.helper.make_node("Tanh", ["sum"], ["act"]),
    ]
    inputs = [onnx.helper.make_tensor_value_info("obs", kind, [1, 48])]
    outputs = [onnx.helper.make_tensor_value_info("act", kind, [1, 12])]
    graph = onnx.helper.make_graph(nodes, "policy", inputs, outputs, [weights, bias])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    return model


def _mutate_graph(graph: Any, rng: Rng) -> None:
    """Make one random change of a node, the inputs or outputs, or the weights of an ONNX graph, in place."""
    node = graph.node[rng.integers(len(graph.node))]
    match int(rng.integers(9)):
        case 0:
            node.op_type = _OPERATORS[rng.integers(len(_OPERATORS))]
        case 1:
            del node.input[rng.integers(len(node.input) + 1) :]
        case 2 if _has_shape(graph):
            sizes = graph.input[0].type.tensor_type.shape.dim
            sizes[rng.integers(len(sizes))].dim_value = int(rng.choice([0, 1, -1, 12, 2**31, 2**40]))
        case 3 if graph.input:
            del graph.input[0].type.tensor_type.shape.dim[int(rng.integers(2)) :]
        case 4:
            inputs_or_outputs = graph.input if rng.integers(2) else graph.output
            del inputs_or_outputs[:]
        case 5:
            tensor = graph.initializer[rng.integers(len(graph.initializer))]
            tensor.dims[0] = int(rng.choice([0, 1, -1, 2**31, 2**40]))
        case 6:
            tensor = graph.initializer[rng.integers(len(graph.initializer))]
            tensor.raw_data = mutate_bytes(tensor.raw_data, rng, 3)
        case 7 if graph.input:
            graph.input[0].type.tensor_type.elem_type = int(rng.integers(20))
        case _:
            graph.node.add().CopyFrom(node)


def _has_shape(graph: Any) -> bool:
    """Return True if the first input of an ONNX graph has a shape, a list of dimensions."""
    return bool(graph.input and graph.input[0].type.tensor_type.shape.dim)


def write_bundle(folder: Path, rng: Rng) -> Path:
    """Copy the folder of the shipped policy `residual`, and make random changes in one copied file.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of the copied folder.
    """
    shutil.copytree(MODELS / "residual", folder / "policy")
    file = folder / "policy" / (bundle.WEIGHTS if rng.random() < BYTES_SHARE else bundle.DESCRIPTION)
    if file.name == bundle.WEIGHTS or rng.random() < BYTES_SHARE:
        file.write_bytes(mutate_bytes(file.read_bytes(), rng, _change_count(rng)))
    else:
        tree = mutate_tree(json.loads(file.read_bytes()), rng, _change_count(rng))
        file.write_text(json.dumps(tree), encoding="utf-8")
    return folder / "policy"


def write_sb3(folder: Path, rng: Rng) -> Path:
    """Write a ZIP archive like a model of Stable-Baselines3, with random changes.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of the archive.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("data", json.dumps(mutate_tree({"policy_class": "x", "observation_space": {"n": 48}}, rng)))
        archive.writestr("policy.pth", rng.bytes(200))
    file = folder / "model.zip"
    file.write_bytes(mutate_bytes(content.getvalue(), rng, _change_count(rng)))
    return file


def write_terrain(folder: Path, rng: Rng) -> Path:
    """Write the TOML file of a terrain and the NumPy file with its heights, with random changes.

    Args:
        folder: Empty folder.
        rng: Random generator.

    Returns:
        Path of the TOML file.
    """
    content = io.BytesIO()
    np.save(content, rng.random((20, 30)))
    array = content.getvalue()
    if rng.random() < ARRAY_SHARE:
        array = mutate_bytes(array[:_NPY_HEADER], rng) + array[_NPY_HEADER:]
    (folder / "hill.npy").write_bytes(array)
    return settings_writer(samples.TERRAIN, "hill.toml", "none.onnx")(folder, rng)


def _change_count(rng: Rng) -> int:
    """Draw the number of random changes of a file: 1 (probability 1/2), 2 (1/4) or 4 (1/4)."""
    return int(rng.choice([1, 1, 2, 4]))


def _to_text(tree: Any, suffix: str) -> bytes:
    """Format nested values as JSON, TOML or YAML in UTF-8; the file suffix determines the format."""
    if suffix == ".json":
        return json.dumps(tree).encode()
    if suffix == ".toml":
        return "".join(f"{key} = {_to_toml(value)}\n" for key, value in tree.items()).encode(errors="replace")
    return bytes(import_package("yaml").safe_dump(tree, sort_keys=False, allow_unicode=True).encode())


def _to_toml(value: Any) -> str:
    """Format a value as TOML text; NaN and infinity are allowed, and None becomes an empty text."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(str(key))} = {_to_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_to_toml, value)) + "]"
    return '""' if value is None else json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")
