"""`python -m train export`: a trained residual as one ONNX file, which every command takes where it takes policies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.hardware import parse_robot_option
from policies.external import onnx_file
from quad_env.cli.command_line import UsageError, make_folder_of

CHECKED_OBSERVATIONS = 10_000
"""Observations at which the file must agree with the bundle."""


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
    """Write the file; the exit code. Raises UsageError, PolicyError or OSError."""
    if options.out.suffix != ".onnx":
        raise UsageError(f"--out must be an .onnx, not {options.out}")
    make_folder_of(options.out, "--out")
    robot = None if options.robot is None else parse_robot_option(options.robot).robot_model
    found = onnx_file.export_residual(options.folder, options.out, CHECKED_OBSERVATIONS, robot)
    print(
        f"{options.out}: agrees with the bundle at {CHECKED_OBSERVATIONS:,} random observations to {found:.1e} of the authority"
    )
    return 0
