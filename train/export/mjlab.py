"""Writer of mjlab's deployment file: `policy.onnx` with the specification of the policy as metadata.

The metadata has the keys and the format that mjlab writes since version 1.6: lists with commas, and lists within them
with semicolons. mjlab keeps the history of an observation term oldest step first, filled with the first value. The file
has no control rate, no clock and no other action than `default_joint_pos + action_scale * action`. A history of 0 steps
is the present value alone; programs that read mjlab's policies refuse other histories, or stack them.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from policies.external.readers.mjlab_onnx import CONTROL_RATE
from policies.external.spec import SpecTerm
from train.export.export_format import ExportFormat, check_terms, raise_unsupported
from train.export.network_files import write_onnx
from train.export.plain_network import PlainNetwork

TERMS = {
    "linear_velocity": "base_lin_vel",
    "angular_velocity": "base_ang_vel",
    "projected_gravity": "projected_gravity",
    "joint_position": "joint_pos",
    "joint_velocity": "joint_vel",
    "previous_action": "actions",
    "command": "command",
}
"""Name of an observation term -> name in mjlab's velocity tasks."""
REASONS = {"gait_clock": "mjlab's tasks have no clock, and the metadata of a term has no parameter for its period"}
"""Name of an observation term -> reason why mjlab lacks it."""
COMMAND = "twist"
"""Name of the command in mjlab's velocity tasks."""


def write(network: PlainNetwork, folder: Path) -> PlainNetwork:
    """Write a network with mjlab's metadata, and return it.

    PolicyError is raised for a term that mjlab lacks, or if the control rate is not the one of its velocity tasks.

    Args:
        network: Plain network.
        folder: Folder of the export.

    Returns:
        The network as written.
    """
    check_terms(network, TERMS, FORMAT.name, REASONS)
    if not np.isclose(network.spec.control_rate, CONTROL_RATE):
        raise_unsupported(FORMAT.name, "control rate", f"{network.spec.control_rate:g} Hz", f"{CONTROL_RATE:g} Hz")
    write_onnx(network, folder / FORMAT.onnx, _metadata(network))
    return network


def _metadata(network: PlainNetwork) -> dict[str, str]:
    """Return the metadata of the ONNX file: key -> text."""
    spec = network.spec
    return {
        "run_path": "simple-quad",
        "joint_names": ",".join(spec.joints),
        "joint_stiffness": _format(spec.stiffness),
        "joint_damping": _format(spec.damping),
        "default_joint_pos": _format(spec.default_position),
        "command_names": COMMAND,
        "observation_names": ",".join(TERMS[term.name] for term in spec.terms),
        "observation_terms_scale": ",".join(_format(term.scale, ";") for term in spec.terms),
        "observation_terms_flatten_history_dim": ",".join("1.000" for _ in spec.terms),
        "observation_terms_history_length": ",".join(_history(term) for term in spec.terms),
        "observation_terms_clip": ",".join("-inf;inf" for _ in spec.terms),
        "action_scale": _format(spec.action_scale),
    }


def _history(term: SpecTerm) -> str:
    """Return the history of an observation term as text: the number of its steps, or 0 for the present value alone."""
    return f"{term.history if term.history > 1 else 0:.3f}"


def _format(values: Iterable[float], separator: str = ",") -> str:
    """Return numbers as text, with as many digits as the numbers have."""
    return separator.join(repr(float(value)) for value in values)


FORMAT = ExportFormat(
    name="mjlab",
    summary="policy.onnx with the metadata of mjlab's exporter, for programs that run mjlab's policies",
    settings="policy.onnx",
    onnx="policy.onnx",
    usage="`cp policy.onnx RUN/`, next to the checkpoints of an mjlab run; deployment programs read its metadata",
    write=write,
)
"""Format of mjlab."""
