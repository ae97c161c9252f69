"""README.md of an export: its files, and the commands that run them in their project and here."""

from pathlib import Path

from policies.external.readers.toml_file import as_toml
from train.export.export_format import ExportFormat
from train.export.plain_network import PlainNetwork
from train.export.stand_alone import PROGRAM

FILE = "README.md"
"""Name of the file."""


def write(network: PlainNetwork, export_format: ExportFormat, source: str, has_program: bool, folder: Path) -> None:
    """Write the README.md of an export.

    Args:
        network: Network as written.
        export_format: Format of the export.
        source: Path or name of the exported policy.
        has_program: True if the export contains the stand-alone program.
        folder: Folder of the export.
    """
    spec = network.spec
    terms = ", ".join(f"{term.name} x {term.history}" if term.history > 1 else term.name for term in spec.terms)
    program = (
        f"`python {PROGRAM}` walks in a window, `python {PROGRAM} --headless` without one; both print the distance."
    )
    missing = f"There is no {PROGRAM}: a colliding part of {network.robot.name} is a mesh."
    lines = [
        f"# {Path(source).name} for {network.robot.name}, {export_format.name}",
        "",
        f"Files: {export_format.summary}.",
        f"There: {export_format.usage.format(robot=network.robot.name)}.",
        program if has_program else missing,
        f"Here: `python -m evaluate --policies {export_format.settings} --robot {network.robot.name}`.",
        f"Observation: {terms}. Rate: {spec.control_rate:g} Hz.",
        f"Joints: {' '.join(spec.joints)}.",
        f"Gains: stiffness {as_toml('stiffness', spec.stiffness)}, damping {as_toml('damping', spec.damping)}.",
        "Walk on soft ground with the robot hung up first; a policy is no safety layer.",
    ]
    (folder / FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
