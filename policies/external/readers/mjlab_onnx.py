"""The description that mjlab's exporter writes into an ONNX file, as metadata.

Sources: mujocolab/mjlab `rl/exporter_utils.py`, unitree_rl_mjlab: lists separated by commas. Older files have no scale,
clip and history of the terms: in mjlab's tasks these are 1, none and 1. No file has the control rate: in mjlab's
velocity tasks it is 50 Hz (`velocity_env_cfg.py`, decimation 4 at 0.005 s).
"""

import json
from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.packages import import_package
from policies.external.readers.isaac_terms import make_term
from policies.external.readers.settings import WRITE_TOML, FileSettings, find_network
from policies.external.spec import ObservationTerm, PolicySpec
from quad_env.files.reading import max_network_size, read_bytes
from quad_env.files.text import brief, format_exception

CONTROL_RATE = 50.0
_FUNCTIONS = {
    "command": "generated_commands",
    "joint_pos": "joint_pos_rel",
    "joint_vel": "joint_vel_rel",
    "actions": "last_action",
}
"""Terms whose function has another name."""
_LISTS = "scale", "clip", "history_length"
_RANDOM = frozenset(
    ("RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli")
)
"""Operators with random outputs."""
MAX_LISTED = 20_000
"""Largest number of characters of an entry of the metadata."""


def parse_spec(file: Path) -> PolicySpec | None:
    """The policy of a file with such metadata; None for one without. Raises PolicyError."""
    metadata = read_metadata(file)
    if not {"joint_names", "observation_names"} <= metadata.keys():
        return None
    found = FileSettings(
        {key: text.split(",") if key.endswith("_names") else _values(text) for key, text in metadata.items()}, file
    )
    if len(commands := found.texts("command_names")) != 1:
        raise PolicyError(f"the commands are {', '.join(commands)}: one of velocities is read", WRITE_TOML)
    return PolicySpec(
        network=find_network(file.parent, file.name),
        control_rate=CONTROL_RATE,
        joints=found.texts("joint_names"),
        default_position=found.numbers("default_joint_pos"),
        action_scale=found.numbers("action_scale"),
        stiffness=found.numbers("joint_stiffness"),
        damping=found.numbers("joint_damping"),
        terms=_terms(found),
        remarks=(f"{file.name} does not say the control rate; read as {CONTROL_RATE:g} Hz, that of mjlab's tasks",),
    )


def _terms(found: FileSettings) -> tuple[ObservationTerm, ...]:
    names = found.texts("observation_names")
    lists = [found.find(f"observation_terms_{key}") or [None] * len(names) for key in _LISTS]
    if any(not isinstance(each, list) or len(each) != len(names) for each in lists):
        raise PolicyError(f"`observation_terms_…` and `observation_names` in {found.file.name} differ in length")
    terms = []
    for name, *values in zip(names, *lists, strict=True):
        each = FileSettings(dict(zip(_LISTS, values, strict=True)), found.file, f"{name}.")
        if each.find("clip") == [-inf, inf]:
            del each.values["clip"]
        terms.append(make_term(_FUNCTIONS.get(name, name), each))
    return tuple(terms)


def _values(text: str) -> Any:
    """The numbers and lists of a text; the text itself where it is of another kind."""
    try:
        found = json.loads(f"[{text.replace('inf', 'Infinity')}]")
    except (ValueError, RecursionError):
        return text
    return found[0] if len(found) == 1 and not isinstance(found[0], list) else found


def read_metadata(file: Path) -> dict[str, str]:
    """Return the metadata of a file that holds all of its network.

    Raises PolicyError where weights lie in another file, and where the network draws random numbers.
    """
    onnx = import_package("onnx")
    try:
        model = onnx.load_model_from_string(read_bytes(file, max_network_size()))
        metadata = {entry.key: entry.value for entry in model.metadata_props}
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except Exception as error:
        raise PolicyError(f"{file.name} cannot be read as ONNX: {format_exception(error)}") from None
    if random := next((node.op_type for node in _nodes(model) if node.op_type in _RANDOM), None):
        raise PolicyError(
            f"{file.name} draws random numbers, by the operator {random}", "export the mean of the actions"
        )
    for key, value in metadata.items():
        if not isinstance(key, str) or not isinstance(value, str):  # the parser gives invalid UTF-8 as bytes
            raise PolicyError(f"{file.name} has metadata at {brief(key)} that is no UTF-8")
        if len(value) > MAX_LISTED and key != "simple_quad_policy":
            raise PolicyError(f"{file.name}: metadata of {len(value)} characters at {brief(key)}, at most {MAX_LISTED}")
    if _outside(model):
        remedy = "write them into it: onnx.save(onnx.load(file), file)"
        raise PolicyError(f"the weights of {file.name} lie in another file", remedy)
    return metadata


def _nodes(model: Any) -> Iterator[Any]:
    """Yield all nodes of a model, also those of loops, branches and functions."""
    waiting = [model.graph, *model.functions]
    while waiting:
        for node in waiting.pop().node:
            yield node
            for attribute in node.attribute:
                waiting += [attribute.g] if attribute.HasField("g") else []
                waiting += attribute.graphs


def _outside(message: Any) -> bool:
    """Whether a part of a model is in another file (`TensorProto.external_data`)."""
    for field, value in message.ListFields():
        if field.name == "external_data" or (field.name == "data_location" and value == 1):
            return True
        if field.message_type is not None and any(map(_outside, [value] if hasattr(value, "ListFields") else value)):
            return True
    return False
