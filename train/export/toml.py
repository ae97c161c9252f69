"""Writer of this project's deployment file: `policy.toml` and `policy.onnx`."""

from dataclasses import replace
from pathlib import Path

from policies.external.readers.toml_file import write_toml
from train.export.export_format import ExportFormat
from train.export.network_files import write_onnx
from train.export.plain_network import PlainNetwork


def write(network: PlainNetwork, folder: Path) -> PlainNetwork:
    """Write a network with its specification as a TOML, and return it.

    Args:
        network: Plain network.
        folder: Folder of the export.

    Returns:
        The network as written.
    """
    write_onnx(network, folder / FORMAT.onnx)
    write_toml(replace(network.spec, network=folder / FORMAT.onnx), folder / FORMAT.settings)
    return network


FORMAT = ExportFormat(
    name="toml",
    summary="policy.toml, which describes everything, and policy.onnx",
    settings="policy.toml",
    onnx="policy.onnx",
    usage="`python -m quad_env doctor --policy policy.toml`",
    write=write,
    describes_all=True,
)
"""Format of this project."""
