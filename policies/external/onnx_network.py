"""Networks in ONNX files: session of ONNX runtime, roles of inputs and outputs, metadata of the file.

An input of a network is the observation or a recurrent state (memory). An output is the action or the new value of a
recurrent state, which is called its update.

Sources for the names of inputs and outputs: rsl_rl `utils/exporter.py` and Isaac Lab `isaaclab_rl/rsl_rl/exporter.py`
(`obs`, `h_in`, `c_in` -> `actions`, `h_out`, `c_out`); rl_games' exporters (`obs`, `states` -> `mu`, `log_std`,
`value`, `out_state_*`).
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from policies.base import PolicyError
from policies.external.act_function import ActFunction
from policies.external.packages import import_package
from policies.network import Weights
from quad_env.files.reading import max_network_size, read_bytes
from quad_env.files.text import brief, format_exception

INPUT_TYPES: dict[str, type[np.floating]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}
"""Number type of a network input, as named by ONNX runtime -> NumPy type.

Other number types are not supported.
"""
ACTIONS = ("actions", "action"), ("mu", "mean", "action_mean", "actions_mean", "deterministic_actions"), ("output",)
"""Groups of usual names of a network's action output, in lower case, in the order of preference.

The first group that contains the name of exactly one output determines the action output.
"""
OBSERVATIONS = "obs", "observation", "observations", "policy", "input", "features"
"""Usual names, in lower case, of the network input for the observation, if a network has several inputs."""
RESIDUAL_METADATA = "simple_quad_policy"
"""Metadata key for the `policy.json` of the bundle, in the ONNX file of a residual policy."""
MAX_METADATA = 20_000
"""Maximum number of characters of a value in the metadata of an ONNX file.

The value under the key RESIDUAL_METADATA has no limit.
"""
_DIRECTION_WORDS = frozenset(
    (
        "in",
        "out",
        "input",
        "output",
        "prev",
        "previous",
        "next",
        "new",
        "old",
        "last",
        "init",
        "final",
        "updated",
    )
)
"""Words that distinguish the names of a recurrent state's input and output, such as `h_in` and `h_out`."""
_STEP = re.compile(r"([a-z]+?)_?(?:0|1|n|t)")
"""Pattern of names such as `h0` (input: recurrent state) and `hn` (output: its update).

The group of the pattern matches the common part of the names, here `h`.
"""
_RANDOM_OPERATORS = frozenset(
    ("RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli")
)
"""ONNX operators with random outputs; networks with these operators are rejected."""


@dataclass(frozen=True)
class NetworkRoles:
    """Inputs and outputs of an ONNX network by role.

    Each input or output is an object of ONNX runtime with the attributes `name`, `shape` and `type`.
    """

    observation: Any
    """Network input that receives the observation."""
    action: Any
    """Network output with the action."""
    memory: tuple[tuple[Any, Any], ...]
    """Pairs for the recurrent states: network input, and network output with the next value of the state."""


def open_session(file: Path) -> Any:
    """Return a session of ONNX runtime that computes the network in a file, with a single thread.

    Raises PolicyError, one line, if the file is invalid.
    """
    runtime = import_package("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise PolicyError(f"{file} cannot be read as ONNX: {format_exception(error)}") from error


def make_network_factory(session: Any, file: Path) -> tuple[Callable[[], ActFunction], bool]:
    """Return a factory of functions that call an ONNX network with one observation and return one action.

    Args:
        session: Session of ONNX runtime, from `open_session`.
        file: Path of the network, named in errors.

    Returns:
        factory: Function without arguments. It returns a function from one observation to one action, with a recurrent
            state of its own that is initially zero.
        has_memory: True for a recurrent network.

    Raises:
        PolicyError: The network has no observation or action, or an input has an unsupported type or shape.
    """
    if not session.get_inputs() or not session.get_outputs() or not session.get_inputs()[0].shape:
        raise PolicyError(f"{file} has no input of an observation, a vector, or no output")
    roles = find_roles(session.get_inputs(), session.get_outputs(), file)
    _check_inputs(roles, file)
    observation = roles.observation
    states = [state for state, _ in roles.memory]
    shapes = [[size if isinstance(size, int) else 1 for size in state.shape] for state in states]
    output_names = [roles.action.name, *(update.name for _, update in roles.memory)]
    is_vector = len(observation.shape) == 1

    def make() -> ActFunction:
        memory = {
            state.name: np.zeros(shape, INPUT_TYPES[state.type]) for state, shape in zip(states, shapes, strict=True)
        }

        def act(row: Weights) -> Any:
            values = row.astype(INPUT_TYPES[observation.type])
            inputs = {observation.name: values if is_vector else values[None]}
            action, *updates = session.run(output_names, inputs | memory)
            memory.update(zip(memory, updates, strict=True))
            return action if is_vector or np.shape(action)[:1] != (1,) else action[0]

        return act

    return make, bool(states)


def _check_inputs(roles: NetworkRoles, file: Path) -> None:
    """Raise PolicyError if a network input has an unsupported type, or the observation a wrong shape."""
    shape = roles.observation.shape
    inputs = (roles.observation, *(state for state, _ in roles.memory))
    other = next((each.type for each in inputs if each.type not in INPUT_TYPES), None)
    if other is not None:
        raise PolicyError(f"{file} reads {other}: it must read float or double")
    is_batch = len(shape) == 2 and not isinstance(shape[0], int)
    if not shape or (shape[:-1] not in ([], [1]) and not is_batch):
        raise PolicyError(f"{file} reads {shape}: it must read one observation, or a batch of any size")


def find_roles(inputs: Sequence[Any], outputs: Sequence[Any], file: Path) -> NetworkRoles:
    """Find the observation, the action and the recurrent states among a network's inputs and outputs.

    The search uses first the names and then the shapes of the inputs and outputs.

    Args:
        inputs: Inputs of the network, objects of ONNX runtime with `name` and `shape`.
        outputs: Outputs of the network, objects of ONNX runtime with `name` and `shape`.
        file: Path of the network, named in errors.

    Returns:
        Inputs and outputs by role.

    Raises:
        PolicyError: The role of an input or output follows from neither its name nor its shape.
    """
    if not inputs or not outputs:
        counts = f"{len(inputs)} inputs and {len(outputs)} outputs"
        raise PolicyError(f"{file} has {counts}: it must have one or more of each")
    observation = inputs[0] if len(inputs) == 1 else _find_observation(inputs, outputs)
    states = [each for each in inputs if each is not observation]
    updates = {
        state.name: update for state in states if (update := _find_update_by_name(state, inputs, outputs)) is not None
    }
    action = _find_action([each for each in outputs if each not in updates.values()], file)
    for state in states:
        free = [each for each in outputs if each is not action and each not in updates.values()]
        if state.name not in updates:
            updates[state.name] = _find_update_by_shape(state, states, free, file)
    return NetworkRoles(observation, action, tuple((state, updates[state.name]) for state in states))


def _find_observation(inputs: Sequence[Any], outputs: Sequence[Any]) -> Any:
    """Return the network input that receives the observation.

    If exactly one input has a usual name (OBSERVATIONS), such as `obs`, it is the observation. Otherwise, the
    observation is the only input that is not updated by an output with the same name. If there are several of these
    inputs, or none, the observation is the first input.
    """
    named = [each for each in inputs if each.name.lower() in OBSERVATIONS]
    if len(named) == 1:
        return named[0]
    not_updated = [each for each in inputs if _find_update_by_name(each, inputs, outputs) is None]
    return not_updated[0] if len(not_updated) == 1 else inputs[0]


def _find_action(outputs: Sequence[Any], file: Path) -> Any:
    """Return the network output with the action, found by a usual name (ACTIONS) or by its width of 12.

    Raises PolicyError if no output matches, or if several outputs match.
    """
    for group in ACTIONS:
        named = [each for each in outputs if each.name.lower() in group]
        if len(named) == 1:
            return named[0]
    of_joints = [each for each in outputs if each.shape and each.shape[-1] == 12]
    candidates = of_joints if len(outputs) > 1 else outputs
    if len(candidates) == 1:
        return candidates[0]
    names = ", ".join(each.name for each in outputs)
    raise PolicyError(f"{file} has the outputs {names}, and none is called actions", "rename the output of the actions")


def _find_update_by_name(state: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> Any | None:
    """Return the network output that updates a recurrent state, found by its name, or None.

    The output must have the name and the shape of the input `state`. Words such as `in` and `out` in the names are
    ignored. Returns None if no output or several outputs match, or if several inputs have this name.
    """
    if sum(_stem(each.name) == _stem(state.name) for each in inputs) > 1:
        return None
    candidates = [each for each in outputs if _stem(each.name) == _stem(state.name) and _has_same_shape(state, each)]
    return candidates[0] if len(candidates) == 1 else None


def _find_update_by_shape(state: Any, states: Sequence[Any], free: Sequence[Any], file: Path) -> Any:
    """Return the network output that updates a recurrent state, found by its shape.

    It is the only output in `free`, the outputs that have no role yet, with the shape of the input `state`. Raises
    PolicyError if no output or several outputs match, or if another recurrent state in `states` has this shape.
    """
    candidates = [each for each in free if _has_same_shape(state, each)]
    rivals = [each for each in states if each is not state and _has_same_shape(each, state)]
    if len(candidates) == 1 and not rivals:
        return candidates[0]
    if not candidates:
        raise PolicyError(f"{file} reads {state.name} besides the observation, and no output updates it")
    names = ", ".join(each.name for each in candidates)
    fault = f"{file} reads {state.name} besides the observation, and {names} may update it"
    stem = _stem(state.name)
    raise PolicyError(fault, f"name the output by the input, such as {stem}_in and {stem}_out")


def _stem(name: str) -> str:
    """Return the part that the names of a recurrent state and its update have in common, in lower case.

    For example, the result is `h` for `h_in`, `h_out`, `h0` and `hn`.
    """
    words = [word for word in re.split(r"[^a-z0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()) if word]
    stem = "_".join(word for word in words if word not in _DIRECTION_WORDS) or name.lower()
    return match[1] if (match := _STEP.fullmatch(stem)) and len(match[1]) <= 2 else stem


def _has_same_shape(state: Any, output: Any) -> bool:
    """Return True if the shapes of a network input `state` and a network `output` can be equal.

    The number of dimensions must be the same. Sizes that are not numbers are unknown and fit every size.
    """
    if len(state.shape) != len(output.shape):
        return False
    pairs = zip(state.shape, output.shape, strict=True)
    return all(not isinstance(a, int) or not isinstance(b, int) or a == b for a, b in pairs)


def read_metadata(file: Path) -> dict[str, str]:
    """Read the metadata of an ONNX file, and check that its network is complete and deterministic.

    Args:
        file: Path of the ONNX file.

    Returns:
        Key of the metadata -> text under this key.

    Raises:
        PolicyError: The file cannot be read, its weights are in another file, its metadata is invalid, or its network
            draws random numbers.
    """
    onnx = import_package("onnx")
    try:
        model = onnx.load_model_from_string(read_bytes(file, max_network_size()))
        metadata = {entry.key: entry.value for entry in model.metadata_props}
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except Exception as error:
        raise PolicyError(f"{file.name} cannot be read as ONNX: {format_exception(error)}") from None
    random = next((node.op_type for node in _nodes(model) if node.op_type in _RANDOM_OPERATORS), None)
    if random is not None:
        raise PolicyError(
            f"{file.name} draws random numbers, by the operator {random}", "export the mean of the actions"
        )
    for key, value in metadata.items():
        if not isinstance(key, str) or not isinstance(value, str):  # The parser returns invalid UTF-8 as bytes.
            raise PolicyError(f"{file.name} has metadata at {brief(key)} that is not UTF-8")
        if len(value) > MAX_METADATA and key != RESIDUAL_METADATA:
            length = f"metadata of {len(value)} characters at {brief(key)}, at most {MAX_METADATA}"
            raise PolicyError(f"{file.name}: {length}")
    if _has_external_data(model):
        remedy = "write them into it: onnx.save(onnx.load(file), file)"
        raise PolicyError(f"the weights of {file.name} lie in another file", remedy)
    return metadata


def _nodes(model: Any) -> Iterator[Any]:
    """Yield all nodes (operators) of an ONNX model, including the nodes in loops, branches and functions."""
    waiting = [model.graph, *model.functions]
    while waiting:
        for node in waiting.pop().node:
            yield node
            for attribute in node.attribute:
                waiting += [attribute.g] if attribute.HasField("g") else []
                waiting += attribute.graphs


def _has_external_data(message: Any) -> bool:
    """Return True if a protobuf message of an ONNX model refers to data in another file.

    The reference is `TensorProto.external_data` or a `data_location` of 1. All nested messages are searched.
    """
    for field, value in message.ListFields():
        if field.name == "external_data" or (field.name == "data_location" and value == 1):
            return True
        if field.message_type is None:
            continue
        parts = [value] if hasattr(value, "ListFields") else value
        if any(map(_has_external_data, parts)):
            return True
    return False
