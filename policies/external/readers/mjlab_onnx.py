"""Reader of mjlab's metadata in an ONNX file, which specifies the policy.

The metadata consists of texts; each text is a list separated by commas. Older files lack scale, clip and history of the
observation terms. In mjlab's tasks, the scale is 1, there is no clip, and the history is one step. All files lack the
control rate. In mjlab's velocity tasks it is 50 Hz (`velocity_env_cfg.py`: decimation 4, time step 0.005 s).

Sources: mujocolab/mjlab `rl/exporter_utils.py`, unitree_rl_mjlab.
"""

import json
from math import inf
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.onnx_network import read_metadata
from policies.external.readers.isaac_terms import make_term
from policies.external.readers.settings import WRITE_TOML, FileSettings, find_network
from policies.external.spec import PolicySpec, SpecTerm

CONTROL_RATE = 50.0
"""Control rate of mjlab's velocity tasks, Hz; it is assumed because the ONNX files do not contain it."""
_FUNCTIONS = {
    "command": "generated_commands",
    "joint_pos": "joint_pos_rel",
    "joint_vel": "joint_vel_rel",
    "actions": "last_action",
}
"""Observation term in mjlab's metadata -> Isaac Lab's function for the term, if the names differ."""
_TERM_LISTS = "scale", "clip", "history_length"
"""Settings of the observation terms in mjlab's metadata.

Each setting NAME has the key `observation_terms_NAME`, with a list of one value per term.
"""


def parse_spec(file: Path) -> PolicySpec | None:
    """Parse a policy's specification from mjlab's metadata in an ONNX file.

    Args:
        file: Path of the ONNX file.

    Returns:
        Specification of the policy; None if the file has no metadata of mjlab.

    Raises:
        PolicyError: The metadata is incomplete, or the policy has more than one command.
    """
    metadata = read_metadata(file)
    if not {"joint_names", "observation_names"} <= metadata.keys():
        return None
    settings = FileSettings({key: _parse_entry(key, text) for key, text in metadata.items()}, file)
    commands = settings.texts("command_names")
    if len(commands) != 1:
        raise PolicyError(f"the commands are {', '.join(commands)}; supported: one velocity command", WRITE_TOML)
    return PolicySpec(
        network=find_network(file.parent, file.name),
        control_rate=CONTROL_RATE,
        joints=settings.texts("joint_names"),
        default_position=settings.numbers("default_joint_pos"),
        action_scale=settings.numbers("action_scale"),
        stiffness=settings.numbers("joint_stiffness"),
        damping=settings.numbers("joint_damping"),
        terms=_parse_terms(settings),
        remarks=(f"{file.name} does not say the control rate; read as {CONTROL_RATE:g} Hz, that of mjlab's tasks",),
    )


def _parse_terms(settings: FileSettings) -> tuple[SpecTerm, ...]:
    """Return the observation terms in mjlab's metadata, in the order of the observation.

    Raises PolicyError if the lists of names, scales, clips and histories differ in length.
    """
    names = settings.texts("observation_names")
    lists = [settings.find(f"observation_terms_{key}") or [None] * len(names) for key in _TERM_LISTS]
    if any(not isinstance(values, list) or len(values) != len(names) for values in lists):
        raise PolicyError(f"`observation_terms_…` and `observation_names` in {settings.file.name} differ in length")
    terms = []
    for name, *values in zip(names, *lists, strict=True):
        term_settings = FileSettings(dict(zip(_TERM_LISTS, values, strict=True)), settings.file, f"{name}.")
        if term_settings.find("clip") == [-inf, inf]:
            del term_settings.values["clip"]
        terms.append(make_term(_FUNCTIONS.get(name, name), term_settings))
    return tuple(terms)


def _parse_entry(key: str, text: str) -> Any:
    """Convert the text under a metadata key to a list of names, a number or a list of numbers.

    A key that ends with `_names` has names. Since version 1.6 of mjlab, an entry of a list that is itself a list has
    semicolons between its numbers. Any other text is returned unchanged.
    """
    if key.endswith("_names"):
        return text.split(",")
    if ";" in text:
        text = ",".join(f"[{entry.replace(';', ',')}]" if ";" in entry else entry for entry in text.split(","))
    try:
        values = json.loads(f"[{text.replace('inf', 'Infinity')}]")
    except (ValueError, RecursionError):
        return text
    return values[0] if len(values) == 1 and not isinstance(values[0], list) else values
