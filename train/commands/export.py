"""`python -m train export`: a trained residual as one ONNX file, which every command takes where it takes policies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.hardware import parse_robot_option
from policies.external import onnx_file
from quad_env.cli.command_line import UsageError, make_folder_of

NUM_CHECKED = 10_000
"""Number of random observations for the check of an export.

The check compares the outputs of the ONNX file and of the policy bundle for these observations."""


@dataclass(frozen=True)
class ExportOptions:
    """Export a trained residual."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("models/residual")
    """Folder of a trained policy, or of a training run."""
    robot: str | None = None
    """Robot of the policy, if not a built-in one: the path of its MJCF, URDF or TOML."""
    out: Path = Path("results/residual.onnx")
    """File to write: the network, with the base and all settings of the policy as metadata."""


def main(options: ExportOptions) -> int:
    """Write the ONNX file and return the exit code.

    Raises UsageError, PolicyError or OSError if the policy cannot be exported.
    """
    if options.out.suffix != ".onnx":
        raise UsageError(f"--out must be an .onnx, not {options.out}")
    make_folder_of(options.out, "--out")
    robot = None if options.robot is None else parse_robot_option(options.robot).robot_model
    error = onnx_file.export_residual(options.folder, options.out, NUM_CHECKED, robot)
    print(
        f"{options.out}: agrees with the bundle at {NUM_CHECKED:,} random observations to {error:.1e} of the authority"
    )
    return 0
